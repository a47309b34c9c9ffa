// This finds out whether a sensor, as a file has it, contradicts itself.
#pragma once

#include <string>

#include "centroiding/sensor.h"

namespace curlew {

/// Throws Failure, which names the file, where the windows, references, gains or levels of valid
/// lenslets make no sense, where the grid (P, ORIGIN) is not that of the reference spots, where its
/// parity is not that of the optics, or where the flat is not relative to its own mean. Pixels that
/// hardly respond become bad pixels.
void check_sensor(const std::string& path, Sensor& sensor);

}  // namespace curlew
