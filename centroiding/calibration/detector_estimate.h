// This file declares how calibration completes what is known of the detector from the frames.
#pragma once

#include <string>
#include <vector>

#include "centroiding/calibration/calibrate.h"
#include "centroiding/calibration/lenslet_grid_finder.h"

namespace curlew {

/// Returns the detector with what was not given: e⁻ per ADU and the read noise of one frame. Every
/// guess and every contradiction becomes a note. The gain comes from photon transfer where the
/// reference is a stack, and the read noise from the stack of darks, or from the scatter between
/// the spots over frames and over pixels. `light_adu` is the reference less dark or background.
/// Where all values are multiples of a step and the gain given is that of one step, it is divided
/// by the step.
Detector complete_detector(const CalibrationInput& input, const FoundGrid& found,
                           const Image<float>& light_adu, std::vector<std::string>& notes);

}  // namespace curlew
