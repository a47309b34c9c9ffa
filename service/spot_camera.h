// What the classifier needs to know about the sensor.
#pragma once

#include "centroiding/sensor.h"
#include "detect/classifier/spot_features.h"

namespace curlew {

SpotCamera spot_camera(const Sensor& sensor);

}  // namespace curlew
