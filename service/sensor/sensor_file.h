// The sensor file: a Sensor in FITS, which calibrate writes and replay and run read.
#pragma once

#include <string>

#include "acquisition/recording/provenance.h"
#include "centroiding/sensor.h"
#include "service/program/version.h"

namespace curlew {

/// Writes the keys and images that docs/files.md lists. Throws Failure, which names the file; then
/// no incomplete file is left.
void write_sensor(const std::string& path, const Sensor& sensor,
                  const Provenance& provenance = Provenance(kProgram));

/// Reads a sensor file. Throws Failure if the file is missing, is no sensor file, or contradicts
/// itself.
Sensor read_sensor(const std::string& path);

/// Returns a hash of all that a sensor file says of the sensor. It is the same for a sensor and
/// what is read from its file.
std::string sensor_hash(const Sensor& sensor);

}  // namespace curlew
