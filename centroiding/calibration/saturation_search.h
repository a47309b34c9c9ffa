// This file declares what calibration does about saturation: it finds its level where nobody gave
// it, and refuses references that are overexposed.
#pragma once

#include <string>
#include <vector>

#include "centroiding/calibration/lenslet_grid_finder.h"
#include "centroiding/sensor.h"
#include "core/image.h"

namespace curlew {

/// Takes the largest value of the reference as the saturation level where none was given and that
/// value is no chance: at least 8 pixels hold it, three times as many as any other value in the
/// upper half. Adds a note. Frames without noise say nothing.
void find_saturation(Sensor& sensor, const Image<float>& reference_adu, const FoundGrid& found,
                     std::vector<std::string>& notes);

/// Returns 1 for each lit lenslet with a saturated pixel in its window, [rows, cols] of lenslets.
Image<std::uint8_t> find_saturated_lenslets(const Sensor& sensor,
                                            const Image<float>& reference_adu);

/// Throws Failure where more than a tenth of the reference's spots are saturated.
void refuse_saturated(const Sensor& sensor, const Image<float>& reference_adu);

}  // namespace curlew
