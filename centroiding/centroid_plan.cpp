// This file makes a CentroidPlan: it folds the calibration into one gain and one offset per pixel.
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include "centroiding/centroid.h"
#include "centroiding/centroid_methods.h"
#include "core/error.h"

namespace curlew {
namespace {

// The narrowest vector that the kernel loads has this many pixels.
constexpr int kMinFrameCols = 4;

std::string times(int rows, int cols) { return std::to_string(rows) + "×" + std::to_string(cols); }

void check_fit(const Sensor& sensor, const FrameFormat& format) {
  const auto refuse = [](const std::string& what, const std::string& frames,
                         const std::string& calibrated) {
    throw Failure("the frames' " + what + " is " + frames + " but the sensor was calibrated for " +
                  calibrated + "; set the camera back or calibrate anew");
  };
  if (format.rows != sensor.frame_rows || format.cols != sensor.frame_cols) {
    refuse("size (rows×columns)", times(format.rows, format.cols),
           times(sensor.frame_rows, sensor.frame_cols));
  }
  if (format.offset_x_px != sensor.offset_x_px || format.offset_y_px != sensor.offset_y_px) {
    const auto pair = [](int x, int y) { return std::to_string(x) + ", " + std::to_string(y); };
    refuse("offset (x, y) on the detector", pair(format.offset_x_px, format.offset_y_px),
           pair(sensor.offset_x_px, sensor.offset_y_px));
  }
  if (format.binning != sensor.binning) {
    refuse("binning", std::to_string(format.binning), std::to_string(sensor.binning));
  }
  const int bits = converter_bits(format);
  if (sensor.pixel_bits != 0 && bits != 0 && bits != sensor.pixel_bits) {
    refuse("pixel format", std::to_string(bits) + " bits",
           std::to_string(sensor.pixel_bits) + " bits");
  }
  if (format.cols < kMinFrameCols) {
    throw Failure("frames of " + times(format.rows, format.cols) +
                  " pixels are too narrow; at least " + std::to_string(kMinFrameCols) +
                  " columns are needed");
  }
  if (!(format.scale_adu > 0.0)) throw Failure("the frames' ADU per count must be positive");
}

template <typename T>
void check_map(const Image<T>& map, const Sensor& sensor, const std::string& name) {
  if (map.empty()) return;
  if (map.rows() != sensor.frame_rows || map.cols() != sensor.frame_cols) {
    throw Failure("the sensor's " + name + " map is " + times(map.rows(), map.cols()) +
                  " but its frames are " + times(sensor.frame_rows, sensor.frame_cols) +
                  "; calibrate anew");
  }
}

void check_options(const CentroidOptions& options) {
  const auto require = [](bool ok, const std::string& what) {
    if (!ok) throw UsageError("centroid option " + what);
  };
  require(options.threshold_adu >= 0.0, "threshold_adu must be 0 or more");
  require(options.threshold_relative >= 0.0 && options.threshold_relative < 1.0,
          "threshold_relative must be in [0, 1)");
  require(options.threshold_noise >= 0.0, "threshold_noise must be 0 or more");
  require(options.min_snr >= 0.0, "min_snr must be 0 or more");
  require(options.edge_fraction >= 0.0 && options.edge_fraction <= 0.25,
          "edge_fraction must be in [0, 0.25]");
  require(options.max_bad_fraction >= 0.0 && options.max_bad_fraction <= 1.0,
          "max_bad_fraction must be in [0, 1]");
  require(options.spot_sigma_px >= 0.0 && options.spot_sigma_px <= kMaxMethodWindow,
          "spot_sigma_px must be in [0, " + std::to_string(kMaxMethodWindow) + "]");
  require(options.reference_pull >= 0.0, "reference_pull must be 0 or more");
  require(options.brightest_pixels >= 0 && options.brightest_pixels <= kMaxBrightestPixels,
          "brightest_pixels must be in [0, " + std::to_string(kMaxBrightestPixels) + "]");
}

/// Refuses a method that the sensor's window gains were not measured with. The two centres of
/// gravity share their gains: they differ only in their thresholds, which may change without a new
/// calibration.
void check_method(const Sensor& sensor, CentroidMethod method) {
  if (method == sensor.method ||
      (is_centre_of_gravity(method) && is_centre_of_gravity(sensor.method))) {
    return;
  }
  const auto quoted = [](CentroidMethod m) { return "'" + std::string(name_of(m)) + "'"; };
  throw Failure("the sensor was calibrated for the centroid method " + quoted(sensor.method) +
                " and the configuration asks for " + quoted(method) +
                "; calibrate with this configuration (--config)");
}

/// Returns the σ, in pixels, that the Gaussian gets where CentroidOptions::spot_sigma_px is 0: it
/// is kSigma times λ/w, or kOfWindow of the widest window's side where λ/w is not known.
double default_spot_sigma_px(const Sensor& sensor) {
  constexpr double kSigma = 0.42;
  constexpr double kOfWindow = 1.0 / 6.0;
  const double slope_rad_per_px = std::abs(sensor.optics.slope_rad_per_px());
  if (slope_rad_per_px > 0.0 && std::isfinite(slope_rad_per_px))
    return kSigma * 2.0 * std::numbers::pi / slope_rad_per_px;
  int side = 0;
  for (const Window& window : sensor.window) side = std::max({side, window.w, window.h});
  return kOfWindow * side;
}

double or_zero(double value) { return std::isfinite(value) ? value : 0.0; }

bool window_is_bad(const Sensor& sensor, const Window& window, double max_bad_fraction) {
  int bad = 0;
  for (int y = window.y0; y < window.y0 + window.h; ++y) {
    for (int x = window.x0; x < window.x0 + window.w; ++x) {
      const auto i = static_cast<std::size_t>(y) * static_cast<std::size_t>(sensor.frame_cols) +
                     static_cast<std::size_t>(x);
      bad += is_bad_pixel(sensor, i) ? 1 : 0;
    }
  }
  return bad > max_bad_fraction * window.w * window.h;
}

// Sets how near the two ends of the window, relative to its centre, the spot may come. Where the
// detector's rim cuts a window off, the reference is near an end already. The spot may then go half
// of the way from there to the end.
void set_limits(int start, int length, double reference, double edge_fraction, float& low,
                float& high) {
  const double centre = start + 0.5 * (length - 1);
  const double half = 0.5 * length;
  const double margin = edge_fraction * length;
  const double ref = std::isfinite(reference) ? reference - centre : 0.0;
  low = static_cast<float>(std::min(-half + margin, 0.5 * (ref - half)));
  high = static_cast<float>(std::max(half - margin, 0.5 * (ref + half)));
}

/// This says what one count of the frames is worth in ADU and in electrons.
struct CountScale {
  CountScale(const Detector& detector, const FrameFormat& format)
      : zero_adu(format.zero_adu),
        adu_per_count(format.scale_adu),
        e_per_count(or_zero(detector.e_per_adu) * format.scale_adu),
        read_noise_counts(e_per_count > 0.0 ? or_zero(detector.read_noise_e) / e_per_count : 0.0) {}

  bool gain_known() const { return e_per_count > 0.0; }
  double counts(double adu) const { return (adu - zero_adu) / adu_per_count; }

  double zero_adu;
  double adu_per_count;
  double e_per_count;        ///< It is not positive where the detector's gain is not known.
  double read_noise_counts;  ///< It is 0 where the gain or the noise is not known.
};

/// Returns that part of the threshold which is the same in all windows, in counts.
double fixed_threshold(const CentroidOptions& options, const CountScale& scale) {
  if (options.method == CentroidMethod::kPlain) return 0.0;
  return std::max(options.threshold_adu / scale.adu_per_count,
                  options.threshold_noise * scale.read_noise_counts);
}

void set_thresholds(const Sensor& sensor, const CentroidOptions& options, const CountScale& scale,
                    CentroidPlan& plan) {
  const double fixed = fixed_threshold(options, scale);
  const bool plain = options.method == CentroidMethod::kPlain;
  plan.threshold = static_cast<float>(fixed);
  plan.relative_threshold = plain ? 0.0F : static_cast<float>(options.threshold_relative);
  if (is_centre_of_gravity(options.method) && !plain && !(options.threshold_relative > 0.0))
    plan.core_threshold = static_cast<float>(sensor.core_threshold);
  plan.uniform_offset = static_cast<float>(scale.counts(sensor.background_adu) + fixed);
  plan.saturation = std::isfinite(sensor.detector.saturation_adu)
                        ? static_cast<float>(scale.counts(sensor.detector.saturation_adu))
                        : std::numeric_limits<float>::infinity();
  plan.min_snr_squared = static_cast<float>(options.min_snr * options.min_snr);
}

/// Sets the scale and the noise of a pixel. Where the detector's gain is not known, nothing is
/// known of the noise, and all variances are 0.
void set_noise(const CountScale& scale, CentroidPlan& plan) {
  const double read_noise = scale.read_noise_counts;
  plan.adu_per_count = static_cast<float>(scale.adu_per_count);
  plan.counts_per_e = scale.gain_known() ? static_cast<float>(1.0 / scale.e_per_count) : 0.0F;
  plan.pixel_variance =
      scale.gain_known() ? static_cast<float>(read_noise * read_noise + 1.0 / 12.0) : 0.0F;
}

void check_window(const Sensor& sensor, int row, int col) {
  const Window& window = sensor.window(row, col);
  if (window.x0 < 0 || window.y0 < 0 || window.w < 1 || window.h < 1 ||
      window.x0 > sensor.frame_cols - window.w || window.y0 > sensor.frame_rows - window.h) {
    throw Failure("the window of lenslet (" + std::to_string(row) + ", " + std::to_string(col) +
                  ") does not lie within the frame of " +
                  times(sensor.frame_rows, sensor.frame_cols) + " pixels; calibrate anew");
  }
}

CentroidPlan::Spot make_spot(const Sensor& sensor, int row, int col,
                             const CentroidOptions& options) {
  const Window& window = sensor.window(row, col);
  CentroidPlan::Spot spot{.x0 = window.x0, .y0 = window.y0, .w = window.w, .h = window.h};
  set_limits(window.x0, window.w, static_cast<double>(sensor.ref_x_px(row, col)),
             options.edge_fraction, spot.min_x, spot.max_x);
  set_limits(window.y0, window.h, static_cast<double>(sensor.ref_y_px(row, col)),
             options.edge_fraction, spot.min_y, spot.max_y);
  spot.state = window_is_bad(sensor, window, options.max_bad_fraction) ? LensletState::kBadPixels
                                                                       : LensletState::kValid;
  return spot;
}

/// Gives every lit lenslet its spot.
void place_spots(const Sensor& sensor, const CentroidOptions& options,
                 Image<CentroidPlan::Spot>& spots) {
  for (int row = 0; row < spots.rows(); ++row) {
    for (int col = 0; col < spots.cols(); ++col) {
      if (sensor.valid(row, col) == 0) continue;
      check_window(sensor, row, col);
      spots(row, col) = make_spot(sensor, row, col, options);
    }
  }
}

/// Returns how many rows of the frame each lenslet row needs, all lenslet rows before it included:
/// where lenslet rows run up the detector, the first of them needs the most.
std::vector<int> count_rows_needed(const Image<CentroidPlan::Spot>& spots) {
  std::vector<int> needed(static_cast<std::size_t>(spots.rows()), 0);
  int needed_so_far = 0;
  for (int row = 0; row < spots.rows(); ++row) {
    for (int col = 0; col < spots.cols(); ++col)
      needed_so_far = std::max(needed_so_far, spots(row, col).y0 + spots(row, col).h);
    needed[static_cast<std::size_t>(row)] = needed_so_far;
  }
  return needed;
}

struct FoldedPixel {
  float gain;
  float offset;
};

/// Folds dark, flat and threshold of pixel i of the frame. A bad pixel has gain 0.
FoldedPixel fold_pixel(const Sensor& sensor, const CountScale& scale, double threshold,
                       std::size_t i) {
  if (is_bad_pixel(sensor, i)) return {.gain = 0.0F, .offset = static_cast<float>(threshold)};
  const double response = sensor.flat.empty() ? 1.0 : static_cast<double>(sensor.flat[i]);
  const double dark =
      sensor.dark_adu.empty() ? sensor.background_adu : static_cast<double>(sensor.dark_adu[i]);
  return {.gain = static_cast<float>(1.0 / response),
          .offset = static_cast<float>(scale.counts(dark) / response + threshold)};
}

/// Fills gain and offset. Both stay empty where the sensor has no maps.
void fold_maps(const Sensor& sensor, const CountScale& scale, double threshold,
               CentroidPlan& plan) {
  if (sensor.dark_adu.empty() && sensor.flat.empty() && sensor.bad_pixel.empty()) return;
  plan.gain = Image<float>(plan.frame_rows, plan.frame_cols);
  plan.offset = Image<float>(plan.frame_rows, plan.frame_cols);
  for (std::size_t i = 0; i < plan.gain.size(); ++i) {
    const FoldedPixel pixel = fold_pixel(sensor, scale, threshold, i);
    plan.gain[i] = pixel.gain;
    plan.offset[i] = pixel.offset;
  }
}

/// Sets the windows' mean gains. They stay when windows are moved, for a flat differs little there.
void set_mean_gains(CentroidPlan& plan) {
  plan.mean_gain.assign(plan.spots.size() + kWidestVector, 1.0F);
  if (plan.gain.empty()) return;
  for (std::size_t k = 0; k < plan.spots.size(); ++k) {
    const CentroidPlan::Spot& spot = plan.spots[k];
    double sum = 0.0;
    int n = 0;
    for (int y = spot.y0; y < spot.y0 + spot.h; ++y) {
      for (int x = spot.x0; x < spot.x0 + spot.w; ++x) {
        const float gain = plan.gain(y, x);
        sum += static_cast<double>(gain);
        n += gain > 0.0F ? 1 : 0;
      }
    }
    if (n > 0) plan.mean_gain[k] = static_cast<float>(sum / n);
  }
}

/// Codes the maps in as few bytes as do them no harm.
void code_pixels(CentroidPlan& plan) {
  // This part of a pixel's noise adds 1/128 to its variance.
  constexpr double kOfNoise = 1.0 / 8.0;
  constexpr double kQuantisation = 1.0 / 12.0;  // counts², where the noise is not known
  if (plan.gain.empty()) return;
  const double dark = std::max(static_cast<double>(plan.pixel_variance), kQuantisation);
  const double most = plan.pixel_type == PixelType::kU8 ? 255.0 : 65535.0;
  const double brightest =
      std::isfinite(plan.saturation) ? std::clamp<double>(plan.saturation, 1.0, most) : most;
  // A gain is as wrong as it makes the brightest pixels.
  const double bright = dark + brightest * static_cast<double>(plan.counts_per_e);
  const CodeTolerance tolerance{.gain = kOfNoise * std::sqrt(bright) / brightest,
                                .offset = kOfNoise * std::sqrt(dark),
                                .brightest = brightest};
  if (!code_in_words(plan.gain, plan.offset, tolerance, plan.words) ||
      static_cast<double>(plan.words.max_count()) < brightest)
    code_maps(plan.gain, plan.offset, tolerance, plan.codes);
}

void check_window_sizes(const CentroidPlan& plan) {
  for (const CentroidPlan::Spot& spot : plan.spots) {
    if (std::max(spot.w, spot.h) <= kMaxMethodWindow) continue;
    throw UsageError("the centroid method '" + std::string(name_of(plan.method)) +
                     "' takes windows of up to " + times(kMaxMethodWindow, kMaxMethodWindow) +
                     " px and the sensor has one of " + times(spot.h, spot.w) +
                     "; use 'thresholded'");
  }
}

/// Returns the reference relative to the window's centre, and 0 where there is no reference.
float from_centre(float reference, int start, int length) {
  const float distance =
      reference - (static_cast<float>(start) + 0.5F * static_cast<float>(length - 1));
  return std::isfinite(distance) ? distance : 0.0F;
}

void place_references(const Sensor& sensor, CentroidPlan& plan) {
  plan.reference_x.resize(plan.spots.size());
  plan.reference_y.resize(plan.spots.size());
  for (std::size_t k = 0; k < plan.spots.size(); ++k) {
    const CentroidPlan::Spot& spot = plan.spots[k];
    plan.reference_x[k] = from_centre(sensor.ref_x_px[k], spot.x0, spot.w);
    plan.reference_y[k] = from_centre(sensor.ref_y_px[k], spot.y0, spot.h);
  }
}

/// Sets what only the methods need that are not centres of gravity.
void prepare_method(const Sensor& sensor, const CentroidOptions& options, const CountScale& scale,
                    CentroidPlan& plan) {
  // A narrower Gaussian would fall between the pixels.
  constexpr double kMinSigmaPx = 0.3;
  check_window_sizes(plan);
  plan.spot_sigma_px = static_cast<float>(
      std::max(options.spot_sigma_px > 0.0 ? options.spot_sigma_px : default_spot_sigma_px(sensor),
               kMinSigmaPx));
  plan.reference_pull = static_cast<float>(options.reference_pull * scale.read_noise_counts);
  int max_pixels = 0;
  for (const CentroidPlan::Spot& spot : plan.spots)
    max_pixels = std::max(max_pixels, spot.w * spot.h);
  plan.brightest_pixels = options.brightest_pixels > 0
                              ? options.brightest_pixels
                              : std::clamp(max_pixels / 4, 1, kMaxBrightestPixels);
  place_references(sensor, plan);
}

}  // namespace

CentroidPlan::CentroidPlan(const Sensor& sensor, const FrameFormat& format,
                           const CentroidOptions& options)
    : spots(sensor.valid.rows(), sensor.valid.cols()),
      strips(spots.rows(), spots.cols()),
      frame_rows(format.rows),
      frame_cols(format.cols),
      pixel_type(format.pixel_type),
      method(options.method) {
  check_fit(sensor, format);
  check_options(options);
  check_map(sensor.dark_adu, sensor, "dark");
  check_map(sensor.flat, sensor, "flat");
  check_map(sensor.bad_pixel, sensor, "bad-pixel");
  check_method(sensor, options.method);

  const CountScale scale(sensor.detector, format);
  set_thresholds(sensor, options, scale, *this);
  set_noise(scale, *this);
  place_spots(sensor, options, spots);
  strips.place(spots, frame_cols);
  rows_needed_ = count_rows_needed(spots);
  fold_maps(sensor, scale, fixed_threshold(options, scale), *this);
  code_pixels(*this);
  set_mean_gains(*this);
  if (!is_centre_of_gravity(method)) prepare_method(sensor, options, scale, *this);
}

}  // namespace curlew
