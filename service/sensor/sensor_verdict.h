// This file declares the verdict on a sensor with which `curlew calibrate` ends.
#pragma once

#include <string>
#include <vector>

#include "centroiding/sensor.h"

namespace curlew {

/// Returns lines on the sensor: the spots against diffraction and pixels, light and its
/// signal-to-noise ratio a lenslet, level, noise and gain, the lenslets, and the methods that suit.
/// `width_over_diffraction` is that of Calibration.
std::vector<std::string> sensor_verdict(const Sensor& sensor, double width_over_diffraction);

}  // namespace curlew
