#include "service/sensor/recording_calibration.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>

#include "acquisition/recording/fits_source.h"
#include "acquisition/recording/recording.h"
#include "core/error.h"
#include "service/sensor/frame_maps.h"
#include "service/sensor/reference_spots.h"

namespace curlew {
namespace {

/// Returns the power of 2 of which all values of the first frame are multiples, as where a camera
/// writes 12 bits into the upper part of 16. It is 1 for 8 bits and for values that are not
/// integers.
int common_step(const std::string& path, const FrameSelection& selection) {
  FitsSource source({path}, selection);
  if (source.format().pixel_type != PixelType::kU16 || source.format().scale_adu != 1.0) return 1;
  FrameBuffer frame(source.format());
  if (source.next(frame) != Delivery::kFrame) return 1;
  const FrameView view = frame.view();
  const auto* pixels = view.data<std::uint16_t>();
  const auto n = static_cast<std::size_t>(view.rows) * static_cast<std::size_t>(view.cols);
  unsigned bits = 0;
  for (std::size_t i = 0; i < n; ++i) bits |= pixels[i];
  constexpr int kLeast = 4;  // Even numbers alone may be sums of two pixels.
  const int step = bits == 0 ? 1 : 1 << std::countr_zero(bits);
  return step >= kLeast ? step : 1;
}

Calibration calibrated(const std::string& name, const CalibrationInput& input) {
  try {
    return calibrate_sensor(input);
  } catch (const Failure& failure) {
    throw Failure(name + ": " + failure.what());
  }
}

}  // namespace

ReferenceFrameSet read_reference_frames(const std::string& path, const FrameSelection& selection) {
  const FitsSource source({path}, selection);
  ReferenceFrameSet set{.mean = read_mean_image(path, selection), .input = {}};
  const MeanImage& mean = set.mean;
  CalibrationInput& input = set.input;
  input.reference_adu = converted<float>(mean.mean);
  input.reference_frames = static_cast<int>(mean.frames);
  if (!mean.variance.empty()) input.reference_variance_adu2 = converted<float>(mean.variance);
  input.adu_per_count = source.format().scale_adu;
  // Only simulated recordings tell the truth.
  input.light_is_cut = read_truth(path).has_value();
  input.value_step = common_step(path, selection);
  const auto is_no_number = [](double adu) { return !std::isfinite(adu); };
  if (std::any_of(mean.mean.begin(), mean.mean.end(), is_no_number)) {
    input.bad_pixel = Image<std::uint8_t>(mean.region.rows, mean.region.cols);
    std::transform(mean.mean.begin(), mean.mean.end(), input.bad_pixel.begin(),
                   [&](double adu) { return static_cast<std::uint8_t>(is_no_number(adu)); });
  }
  input.optics = source.optics();
  input.detector = source.detector();
  input.offset_x_px = source.format().offset_x_px;
  input.offset_y_px = source.format().offset_y_px;
  input.binning = source.format().binning;
  // What 8 bits can hold may be frames of 8 bits that some program wrote as 16.
  constexpr double kLargestOf8Bits = 255.0;
  input.pixel_bits = converter_bits(source.format());
  if (std::none_of(mean.mean.begin(), mean.mean.end(),
                   [](double adu) { return adu > kLargestOf8Bits; }) &&
      input.pixel_bits == 16)
    input.pixel_bits = 0;
  return set;
}

void set_dark(const MeanImage& dark, CalibrationInput& input) {
  input.dark_adu = converted<float>(dark.mean);
  input.dark_variance_adu2 =
      dark.variance.empty() ? Image<float>{} : converted<float>(dark.variance);
}

RecordingCalibration calibrate_on_frames(const std::string& path, const FrameSelection& selection,
                                         CalibrationInput input, const std::string& name) {
  const CentroidOptions options = input.centroid;
  Calibration calibration = calibrated(name, input);
  if (options.follow_level) {
    // Frames may need a higher threshold than their read noise says. Gains must be for that one.
    FitsSource frames({path}, selection);
    input.centroid.threshold_adu = std::max(
        input.centroid.threshold_adu,
        find_frame_threshold_adu(frames, options, calibration.sensor) - calibration.level_adu);
    calibration = calibrated(name, input);
  }
  FitsSource frames({path}, selection);
  ReferenceReport report = measure_reference_spots(frames, options, calibration.sensor);
  return {std::move(calibration), std::move(report.text)};
}

}  // namespace curlew
