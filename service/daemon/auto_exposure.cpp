#include "service/daemon/auto_exposure.h"

#include <spdlog/fmt/fmt.h>

#include <cmath>
#include <utility>

#include "core/error.h"
#include "service/daemon/frame_brightness.h"

namespace curlew {
namespace {

/// Returns the counts at which pixels of this format are saturated.
double saturation_counts(const FrameFormat& format, const Detector& detector) {
  const double adu =
      std::isfinite(detector.saturation_adu)
          ? detector.saturation_adu
          : std::ldexp(1.0, detector.bit_depth > 0 ? detector.bit_depth
                                                   : 8 * static_cast<int>(format.pixel_type)) -
                1.0;
  return (adu - format.zero_adu) / format.scale_adu;
}

}  // namespace

std::string AutoExposure::step(const Camera& camera, const Detector& detector, double pitch_px,
                               bool recording) {
  if (!std::exchange(asked_, true)) tap_.ask();
  const FrameCopy* copy = tap_.answer();
  if (copy == nullptr) return {};
  std::string said;
  try {
    if (recording && !options_.auto_exposure_recording)
      throw Failure(
          "auto_exposure rests while frames are recorded, see auto_exposure_recording in [camera]");
    said = follow(*copy, camera, detector, pitch_px);
    if (!said.empty()) complaint_.clear();
  } catch (const Failure& failure) {
    if (failure.what() != complaint_) said = complaint_ = failure.what();
  }
  tap_.ask();
  return said;
}

std::string AutoExposure::follow(const FrameCopy& copy, const Camera& camera,
                                 const Detector& detector, double pitch_px) {
  const double exposure_us = camera.exposure_us();
  if (!(exposure_us > 0.0))
    throw Failure("auto_exposure: the camera does not tell its exposure time");
  const FrameView frame{copy.pixels.data(), copy.format.rows, copy.format.cols,
                        copy.format.pixel_type};
  const double brightness =
      frame_brightness(frame, pitch_px, saturation_counts(copy.format, detector));
  const double now_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
  const std::optional<double> wanted_us = rule_.look(now_s, brightness, exposure_us);
  if (!wanted_us) return {};
  const double done_us = camera.set_exposure_us(*wanted_us);
  return fmt::format(
      "auto_exposure: {:.6g} us instead of {:.6g}, as the brightest spots were at {:.2f} of "
      "saturation",
      done_us, exposure_us, brightness);
}

}  // namespace curlew
