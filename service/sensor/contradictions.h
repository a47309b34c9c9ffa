// Holds what the frames of a recording say about detector and optics against a sensor file.
#pragma once

#include <string>
#include <vector>

#include "acquisition/recording/fits_source.h"
#include "centroiding/sensor.h"

namespace curlew {

/// Returns a sentence on each thing that the sensor file says differently about detector and optics
/// than the frames do. They matter because thresholds and significances follow the sensor file.
/// `source` has the recording open; its first frame within `selection` is read once more.
/// @throws Error if it cannot be read.
std::vector<std::string> contradictions(const Sensor& sensor, const FitsSource& source,
                                        const std::string& recording,
                                        const FrameSelection& selection);

}  // namespace curlew
