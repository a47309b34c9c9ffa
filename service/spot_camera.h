// The sensor as the vortex classifier needs to know it.
#pragma once

#include "centroiding/sensor.h"
#include "detect/classifier/spot_features.h"

namespace curlew {

SpotCamera spot_camera(const Sensor& sensor);

}  // namespace curlew
