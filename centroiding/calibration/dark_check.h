// This file declares the test of a dark: whether it was taken with the light off.
#pragma once

#include <string>

#include "core/image.h"

namespace curlew {

struct DarkFrame {
  double level_adu = 0.0;  ///< median over the frame
  double noise_adu = 0.0;  ///< of one frame, over frames where it is a stack, else over pixels
};

/// Measures a dark, the mean over `frames` frames with their sample variance (empty for one frame).
DarkFrame measure_dark(const Image<float>& mean_adu, const Image<float>& variance_adu2, int frames);

/// Returns what shows that the dark is lit, as the end of a sentence: a grid of spots, or a level
/// that differs between parts of the frame by more than 20 times the noise. It is empty for a dark.
std::string find_light_in_dark(const Image<float>& mean_adu, const DarkFrame& dark);

}  // namespace curlew
