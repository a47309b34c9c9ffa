// This file declares the picture of a calibration: what was found, window by window.
#pragma once

#include <string>

#include "centroiding/sensor.h"
#include "core/image.h"

namespace curlew {

/// Writes a PNG of the reference, [frame_rows, frame_cols] as it was read. Windows are green where
/// a spot was found and orange where it is saturated; places of the grid that were left out are
/// red where there is light and grey where there is none. Crosses are spots, and bad pixels are
/// magenta. Throws Failure, which names the file.
void write_sensor_picture(const std::string& path, const Sensor& sensor,
                          const Image<float>& reference_adu);

/// Returns the sentence that explains the colours.
std::string sensor_picture_legend(const std::string& path);

}  // namespace curlew
