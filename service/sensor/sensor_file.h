// The sensor file: a Sensor in FITS, as calibrate writes it and replay reads it.
#pragma once

#include <string>

#include "centroiding/sensor.h"

namespace curlew {

/// Writes primary keys and the images of DESIGN.md. Failure names the file; nothing half-written.
void write_sensor(const std::string& path, const Sensor& sensor);

/// Failure where the file is missing, is no sensor file, or contradicts itself.
Sensor read_sensor(const std::string& path);

}  // namespace curlew
