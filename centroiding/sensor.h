// Sensor holds all that calibration knows of one Shack–Hartmann sensor. It is the content of
// SENSOR.fits, which docs/files.md describes.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

#include "centroiding/centroid_method.h"
#include "core/image.h"
#include "core/lenslet_grid.h"
#include "core/optics.h"

namespace curlew {

/// This is a lenslet's window on the detector, in whole pixels.
struct Window {
  int x0 = 0;
  int y0 = 0;
  int w = 0;
  int h = 0;
};

struct Sensor {
  Optics optics;
  Detector detector;

  // This calibration fits only frames of the format that these members describe.
  int frame_rows = 0;
  int frame_cols = 0;
  int offset_x_px = 0;
  int offset_y_px = 0;
  int binning = 1;
  int pixel_bits = 0;  ///< converter_bits() of the reference; 0: frames may have any

  LensletGrid grid;
  double residual_px = 0.0;  ///< rms distance of the reference spots from the grid

  // These maps are [rows, cols] of lenslets.
  Image<std::uint8_t> valid;  ///< 1 where a lenslet is lit
  Image<float> ref_x_px;      ///< position of the reference spot; NaN where not valid
  Image<float> ref_y_px;
  Image<Window> window;  ///< {0,0,0,0} where not valid
  /// Along either axis a spot that is measured q px from its reference, in a window that has
  /// followed it by whole pixels, lies q/gain + bend2·q² + bend3·q³ from it. The gain is 1 where
  /// the window cuts off no light. The curve holds while the spot is within curve_reach_px() of
  /// its window's middle; beyond, the bends stay what they are there. NaN where not valid. The
  /// bends may be empty, for none.
  Image<float> gain_x;
  Image<float> gain_y;
  Image<float> bend2_x;  ///< px⁻¹
  Image<float> bend2_y;
  Image<float> bend3_x;  ///< px⁻²
  Image<float> bend3_y;
  CentroidMethod method = CentroidMethod::kThresholded;            ///< method of the measured gains
  double spot_blur_px = std::numeric_limits<double>::quiet_NaN();  ///< σ; NaN where it is not known
  /// σ of the reference spots above the threshold, px; NaN where it is not known.
  double spot_sigma_px = std::numeric_limits<double>::quiet_NaN();
  /// σ of the Gaussian, integrated over pixels, that the cores of the reference spots are most
  /// like, px; NaN where it is not known.
  double spot_gaussian_px = std::numeric_limits<double>::quiet_NaN();
  /// A reference spot's brightest pixel over the second brightest of its four neighbours; the 90th
  /// percentile of the spots. NaN where it is not known.
  double spot_sharpness = std::numeric_limits<double>::quiet_NaN();
  /// Where spots have wings that change from frame to frame, their positions are those of the light
  /// above this part of each spot's brightest pixel. 0 where it is all light above the threshold.
  double core_threshold = 0.0;
  Image<float> flux_adu;  ///< flux of the reference spots above the threshold; NaN where not valid

  // These maps are [frame_rows, frame_cols], and empty where they were not given.
  double background_adu = 0.0;  ///< subtracted where there is no dark
  Image<float> dark_adu;
  Image<float> flat;  ///< response of the pixels, mean 1 over the good ones
  Image<std::uint8_t> bad_pixel;
};

/// These are the maps of a sensor that hold a number for every lenslet.
inline constexpr std::array kLensletMaps{&Sensor::ref_x_px, &Sensor::ref_y_px, &Sensor::gain_x,
                                         &Sensor::gain_y,   &Sensor::bend2_x,  &Sensor::bend2_y,
                                         &Sensor::bend3_x,  &Sensor::bend3_y,  &Sensor::flux_adu};

/// Returns how far from its window's middle the frame path leaves a spot, px, before it centres the
/// window on it.
inline double spot_reach_px(double pitch_px) { return std::max(0.75, 0.1 * pitch_px); }

/// Returns how far from the middles of their windows the curves of the gains reach, px: what a
/// window cuts off changes within the width of a spot's core, so that no cubic tells it farther.
inline double curve_reach_px(const Sensor& sensor) {
  const double core_px =
      std::isfinite(sensor.spot_gaussian_px) ? sensor.spot_gaussian_px : sensor.spot_sigma_px;
  const double reach_px = std::isfinite(core_px) ? std::max(0.75, core_px) : 0.75;
  return std::min(reach_px, spot_reach_px(sensor.grid.pitch_px()));
}

/// Returns how far a reference at ref_px is from the middle of its window of `length` pixels from
/// `start` on, px: less than half a pixel, by which windows are laid. A window that is cut, or
/// parted from its neighbour, has its middle elsewhere, and 0 is returned.
inline double off_middle_px(double ref_px, int start, int length) {
  constexpr double kLaidOtherwise = 0.6;
  constexpr double kMost = 0.499;
  const double off_px = ref_px - (start + 0.5 * (length - 1));
  return std::abs(off_px) < kLaidOtherwise ? std::clamp(off_px, -kMost, kMost) : 0.0;
}

/// Takes lenslet k out of the sensor.
inline void drop_lenslet(Sensor& sensor, std::size_t k) {
  sensor.valid[k] = 0;
  sensor.window[k] = {};
  for (const auto map : kLensletMaps)
    if (!(sensor.*map).empty()) (sensor.*map)[k] = std::numeric_limits<float>::quiet_NaN();
}

/// Adds `bad` to the sensor's bad pixels. The map is [frame_rows, frame_cols] or empty.
inline void add_bad_pixels(Sensor& sensor, const Image<std::uint8_t>& bad) {
  if (bad.empty()) return;
  if (sensor.bad_pixel.empty()) sensor.bad_pixel = Image<std::uint8_t>(bad.rows(), bad.cols());
  for (std::size_t i = 0; i < std::min(bad.size(), sensor.bad_pixel.size()); ++i)
    sensor.bad_pixel[i] = sensor.bad_pixel[i] != 0 || bad[i] != 0 ? 1 : 0;
}

/// Returns whether pixel i of the frame is bad. A pixel without a usable dark or response is as bad
/// as one that the sensor declares bad.
inline bool is_bad_pixel(const Sensor& sensor, std::size_t i) {
  if (!sensor.bad_pixel.empty() && sensor.bad_pixel[i] != 0) return true;
  if (!sensor.dark_adu.empty() && !std::isfinite(sensor.dark_adu[i])) return true;
  return !sensor.flat.empty() && !(std::isfinite(sensor.flat[i]) && sensor.flat[i] > 0.0F);
}

}  // namespace curlew
