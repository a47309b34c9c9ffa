// This makes the sensor that a simulator is, known without calibrating it.
#pragma once

#include <cmath>
#include <limits>

#include "acquisition/simulator/simulator.h"
#include "service/bench/bench_frames.h"

namespace curlew {

/// Returns a sensor with the windows as simulated, the references where a plane wave's spots lie,
/// and gain 1.
inline Sensor sensor_of(const Simulator& simulator, int window_px, double background_adu) {
  const LensletGrid grid = simulator.grid();
  Sensor sensor = tiled_sensor({grid.rows, grid.cols, window_px});
  sensor.optics = simulator.optics();
  sensor.detector = simulator.detector();
  sensor.background_adu = background_adu;
  sensor.valid = simulator.lit();
  for (std::size_t k = 0; k < sensor.valid.size(); ++k) {
    if (sensor.valid[k] != 0) continue;
    sensor.window[k] = {};
    sensor.ref_x_px[k] = sensor.ref_y_px[k] = std::numeric_limits<float>::quiet_NaN();
  }
  return sensor;
}

}  // namespace curlew
