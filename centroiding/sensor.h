// Sensor: all that calibration knows of one Shack–Hartmann sensor; the content of SENSOR.fits.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>

#include "centroiding/centroid_method.h"
#include "core/image.h"
#include "core/lenslet_grid.h"
#include "core/optics.h"

namespace curlew {

/// A lenslet's window on the detector, in whole pixels.
struct Window {
  int x0 = 0;
  int y0 = 0;
  int w = 0;
  int h = 0;
};

struct Sensor {
  Optics optics;
  Detector detector;

  // The frames this calibration fits.
  int frame_rows = 0;
  int frame_cols = 0;
  int offset_x_px = 0;
  int offset_y_px = 0;
  int binning = 1;

  LensletGrid grid;
  double residual_px = 0.0;  ///< rms distance of reference spots from the grid

  // [rows, cols] of lenslets
  Image<std::uint8_t> valid;  ///< 1 where a lenslet is lit
  Image<float> ref_x_px;      ///< reference spots; NaN where not valid
  Image<float> ref_y_px;
  Image<Window> window;  ///< {0,0,0,0} where not valid
  Image<float> gain_x;   ///< measured over true displacement, 1 where nothing is cut off
  Image<float> gain_y;   ///< NaN where not valid
  CentroidMethod method = CentroidMethod::kThresholded;            ///< that the gains are of
  double spot_blur_px = std::numeric_limits<double>::quiet_NaN();  ///< σ; NaN: not known
  Image<float> flux_adu;  ///< reference spots' flux above threshold; NaN where not valid

  // [frame_rows, frame_cols], empty where not given
  double background_adu = 0.0;  ///< subtracted where there is no dark
  Image<float> dark_adu;
  Image<float> flat;  ///< response, mean 1 over good pixels
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

/// Adds pixels to the sensor's bad ones. bad: [frame_rows, frame_cols] or empty.
inline void add_bad_pixels(Sensor& sensor, const Image<std::uint8_t>& bad) {
  if (bad.empty()) return;
  if (sensor.bad_pixel.empty()) sensor.bad_pixel = Image<std::uint8_t>(bad.rows(), bad.cols());
  for (std::size_t i = 0; i < std::min(bad.size(), sensor.bad_pixel.size()); ++i)
    sensor.bad_pixel[i] = sensor.bad_pixel[i] != 0 || bad[i] != 0 ? 1 : 0;
}

}  // namespace curlew
