// The sensor file: a Sensor in FITS, which calibrate writes and replay and run read.
#pragma once

#include <string>

#include "centroiding/sensor.h"

namespace curlew {

/// Writes the keys and images that docs/files.md lists. Throws Failure, which names the file; then
/// no incomplete file is left.
void write_sensor(const std::string& path, const Sensor& sensor);

/// Reads a sensor file. Throws Failure if the file is missing, is no sensor file, or contradicts
/// itself.
Sensor read_sensor(const std::string& path);

}  // namespace curlew
