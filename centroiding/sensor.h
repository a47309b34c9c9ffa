// Sensor holds all that calibration knows of one Shack–Hartmann sensor. It is the content of
// SENSOR.fits, which docs/files.md describes.
#pragma once

#include <algorithm>
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
  Image<float> gain_x;   ///< measured over true displacement, 1 where the window cuts off no light
  Image<float> gain_y;   ///< NaN where not valid
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

/// Takes lenslet k out of the sensor.
inline void drop_lenslet(Sensor& sensor, std::size_t k) {
  sensor.valid[k] = 0;
  sensor.window[k] = {};
  for (Image<float>* map :
       {&sensor.ref_x_px, &sensor.ref_y_px, &sensor.gain_x, &sensor.gain_y, &sensor.flux_adu})
    (*map)[k] = std::numeric_limits<float>::quiet_NaN();
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
