// The sensor of the simulated camera, calibrated on its own plane wave.
#pragma once

#include "centroiding/centroid.h"
#include "centroiding/sensor.h"

namespace curlew {

/// Returns what `curlew calibrate` would make of plane-wave frames of open_simulated_camera().
Sensor simulated_sensor(const CentroidOptions& options);

}  // namespace curlew
