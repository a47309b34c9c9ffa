// The centroid plan: calibration folded into one gain and one offset per pixel.
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>

#include "centroiding/centroid.h"
#include "centroiding/centroid_methods.h"
#include "core/error.h"

namespace curlew {
namespace {

constexpr int kMinFrameCols = 4;  // the narrowest vector the kernel loads

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

/// Window gains are one method's, and the two centres of gravity differ by no more than their
/// thresholds, which may be changed too.
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

/// CentroidOptions::spot_sigma_px where it is 0.
double default_spot_sigma_px(const Sensor& sensor) {
  constexpr double kSigma = 0.42;  // λ/w
  constexpr double kOfWindow = 1.0 / 6.0;
  const double slope_rad_per_px = std::abs(sensor.optics.slope_rad_per_px());
  if (slope_rad_per_px > 0.0 && std::isfinite(slope_rad_per_px))
    return kSigma * 2.0 * std::numbers::pi / slope_rad_per_px;
  int side = 0;
  for (const Window& window : sensor.window) side = std::max({side, window.w, window.h});
  return kOfWindow * side;
}

double or_zero(double value) { return std::isfinite(value) ? value : 0.0; }

// A pixel without a usable response is as bad as one declared so.
bool is_bad(const Sensor& sensor, std::size_t i) {
  if (!sensor.bad_pixel.empty() && sensor.bad_pixel[i] != 0) return true;
  if (!sensor.dark_adu.empty() && !std::isfinite(sensor.dark_adu[i])) return true;
  return !sensor.flat.empty() && !(std::isfinite(sensor.flat[i]) && sensor.flat[i] > 0.0F);
}

bool window_is_bad(const Sensor& sensor, const Window& window, double max_bad_fraction) {
  int bad = 0;
  for (int y = window.y0; y < window.y0 + window.h; ++y) {
    for (int x = window.x0; x < window.x0 + window.w; ++x) {
      const auto i = static_cast<std::size_t>(y) * static_cast<std::size_t>(sensor.frame_cols) +
                     static_cast<std::size_t>(x);
      bad += is_bad(sensor, i) ? 1 : 0;
    }
  }
  return bad > max_bad_fraction * window.w * window.h;
}

// How near the window's ends (relative to its centre) a spot may come. A window clipped at the
// detector's rim has its reference near an end already; the spot may then go on half the way.
void set_limits(int start, int length, double reference, double edge_fraction, float& low,
                float& high) {
  const double centre = start + 0.5 * (length - 1);
  const double half = 0.5 * length;
  const double margin = edge_fraction * length;
  const double ref = std::isfinite(reference) ? reference - centre : 0.0;
  low = static_cast<float>(std::min(-half + margin, 0.5 * (ref - half)));
  high = static_cast<float>(std::max(half - margin, 0.5 * (ref + half)));
}

}  // namespace

CentroidPlan::CentroidPlan(const Sensor& sensor, const FrameFormat& format,
                           const CentroidOptions& options)
    : spots(sensor.valid.rows(), sensor.valid.cols()),
      frame_rows(format.rows),
      frame_cols(format.cols),
      pixel_type(format.pixel_type),
      rows_needed_(static_cast<std::size_t>(sensor.valid.rows()), 0) {
  check_fit(sensor, format);
  check_options(options);
  check_map(sensor.dark_adu, sensor, "dark");
  check_map(sensor.flat, sensor, "flat");
  check_map(sensor.bad_pixel, sensor, "bad-pixel");
  check_method(sensor, options.method);

  const double e_per_count = or_zero(sensor.detector.e_per_adu) * format.scale_adu;
  const double read_noise =
      e_per_count > 0.0 ? or_zero(sensor.detector.read_noise_e) / e_per_count : 0.0;
  const bool plain = options.method == CentroidMethod::kPlain;
  const double fixed = plain ? 0.0
                             : std::max(options.threshold_adu / format.scale_adu,
                                        options.threshold_noise * read_noise);
  const auto counts = [&](double adu) { return (adu - format.zero_adu) / format.scale_adu; };

  threshold = static_cast<float>(fixed);
  relative_threshold = plain ? 0.0F : static_cast<float>(options.threshold_relative);
  uniform_offset = static_cast<float>(counts(sensor.background_adu) + fixed);
  saturation = std::isfinite(sensor.detector.saturation_adu)
                   ? static_cast<float>(counts(sensor.detector.saturation_adu))
                   : std::numeric_limits<float>::infinity();
  adu_per_count = static_cast<float>(format.scale_adu);
  counts_per_e = e_per_count > 0.0 ? static_cast<float>(1.0 / e_per_count) : 0.0F;
  // Without a known gain nothing is known of the noise: variances are 0.
  pixel_variance =
      e_per_count > 0.0 ? static_cast<float>(read_noise * read_noise + 1.0 / 12.0) : 0.0F;
  min_snr_squared = static_cast<float>(options.min_snr * options.min_snr);
  method = options.method;

  const bool maps = !sensor.dark_adu.empty() || !sensor.flat.empty() || !sensor.bad_pixel.empty();
  std::size_t map_size = kMapMargin;
  for (int row = 0; row < spots.rows(); ++row) {
    for (int col = 0; col < spots.cols(); ++col) {
      const Window& window = sensor.window(row, col);
      if (sensor.valid(row, col) == 0) continue;
      if (window.x0 < 0 || window.y0 < 0 || window.w < 1 || window.h < 1 ||
          window.x0 > frame_cols - window.w || window.y0 > frame_rows - window.h) {
        throw Failure("the window of lenslet (" + std::to_string(row) + ", " + std::to_string(col) +
                      ") does not lie within the frame of " + times(frame_rows, frame_cols) +
                      " pixels; calibrate anew");
      }
      Spot& spot = spots(row, col);
      spot = {.x0 = window.x0, .y0 = window.y0, .w = window.w, .h = window.h};
      set_limits(window.x0, window.w, static_cast<double>(sensor.ref_x_px(row, col)),
                 options.edge_fraction, spot.min_x, spot.max_x);
      set_limits(window.y0, window.h, static_cast<double>(sensor.ref_y_px(row, col)),
                 options.edge_fraction, spot.min_y, spot.max_y);
      spot.state = window_is_bad(sensor, window, options.max_bad_fraction)
                       ? LensletState::kBadPixels
                       : LensletState::kValid;
      spot.map = map_size;
      map_size += static_cast<std::size_t>(window.w) * static_cast<std::size_t>(window.h);
      int& needed = rows_needed_[static_cast<std::size_t>(row)];
      needed = std::max(needed, window.y0 + window.h);
    }
  }
  if (maps) {
    gain.resize(map_size + kMapMargin);
    offset.resize(map_size + kMapMargin);
    for (const Spot& spot : spots) {
      if (spot.state == LensletState::kUnlit) continue;
      std::size_t to = spot.map;
      for (int y = spot.y0; y < spot.y0 + spot.h; ++y) {
        for (int x = spot.x0; x < spot.x0 + spot.w; ++x, ++to) {
          const auto i = static_cast<std::size_t>(y) * static_cast<std::size_t>(frame_cols) +
                         static_cast<std::size_t>(x);
          const bool bad = is_bad(sensor, i);
          const double response = sensor.flat.empty() ? 1.0 : static_cast<double>(sensor.flat[i]);
          const double dark = sensor.dark_adu.empty() ? sensor.background_adu
                                                      : static_cast<double>(sensor.dark_adu[i]);
          gain[to] = bad ? 0.0F : static_cast<float>(1.0 / response);
          offset[to] = static_cast<float>(bad ? fixed : counts(dark) / response + fixed);
        }
      }
    }
  }
  if (!is_centre_of_gravity(method)) {
    constexpr double kMinSigmaPx = 0.3;  // a narrower Gaussian falls between the pixels
    spot_sigma_px = static_cast<float>(std::max(
        options.spot_sigma_px > 0.0 ? options.spot_sigma_px : default_spot_sigma_px(sensor),
        kMinSigmaPx));
    reference_pull = static_cast<float>(options.reference_pull * read_noise);
    int max_pixels = 0;
    for (const Spot& spot : spots) max_pixels = std::max(max_pixels, spot.w * spot.h);
    brightest_pixels = options.brightest_pixels > 0
                           ? options.brightest_pixels
                           : std::clamp(max_pixels / 4, 1, kMaxBrightestPixels);
    reference_x.resize(spots.size());
    reference_y.resize(spots.size());
    for (std::size_t k = 0; k < spots.size(); ++k) {
      const Spot& spot = spots[k];
      if (std::max(spot.w, spot.h) > kMaxMethodWindow) {
        throw UsageError("the centroid method '" + std::string(name_of(method)) +
                         "' takes windows of up to " + times(kMaxMethodWindow, kMaxMethodWindow) +
                         " px and the sensor has one of " + times(spot.h, spot.w) +
                         "; use 'thresholded'");
      }
      const auto relative = [](float reference, int start, int length) {
        const float from_centre =
            reference - (static_cast<float>(start) + 0.5F * static_cast<float>(length - 1));
        return std::isfinite(from_centre) ? from_centre : 0.0F;
      };
      reference_x[k] = relative(sensor.ref_x_px[k], spot.x0, spot.w);
      reference_y[k] = relative(sensor.ref_y_px[k], spot.y0, spot.h);
    }
  }
  // Lenslet rows that run up the detector are met in descending order: make "needed" ascend.
  for (std::size_t row = 1; row < rows_needed_.size(); ++row) {
    rows_needed_[row] = std::max(rows_needed_[row], rows_needed_[row - 1]);
  }
}

}  // namespace curlew
