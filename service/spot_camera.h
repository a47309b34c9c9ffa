// What the classifier needs to know about the sensor.
#pragma once

#include "centroiding/sensor.h"
#include "detect/classifier/spot_features.h"

namespace curlew {

/// Returns the sensor's windows, reference spots, level and noise. Bad pixels have a response of 0.
/// Unknown read noise counts as 0.
SpotCamera spot_camera(const Sensor& sensor);

}  // namespace curlew
