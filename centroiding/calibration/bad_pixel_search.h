// This file declares the search for bad pixels in a dark stack and in a flat.
#pragma once

#include <cstdint>

#include "core/image.h"

namespace curlew {

/// The bad pixels of a detector. A pixel counts under the first of the reasons that it has.
struct BadPixels {
  Image<std::uint8_t> map;  ///< [rows, cols], 1 where bad
  int no_number = 0;        ///< not finite in the dark
  int hot = 0;              ///< the dark's mean lies far above (or below) its neighbourhood's
  int noisy = 0;            ///< the dark's noise lies far above the detector's
  int dead = 0;             ///< as find_dead_pixels() says
};

/// Finds bad pixels. dark_adu is the mean of `frames` darks, [rows, cols], and variance_adu2 their
/// sample variance (empty for one frame); flat is empty or of the same size. A mean is far off
/// beyond 8 robust standard deviations (1.48 MAD) of the differences between pixels and the medians
/// of their 5×5 neighbourhoods, a noise beyond as many of the noises of all pixels. Noise is looked
/// at in stacks of 5 frames and more.
BadPixels find_bad_pixels(const Image<float>& dark_adu, const Image<float>& variance_adu2,
                          int frames, const Image<float>& flat);

/// Returns 1 where find_unresponsive_pixels() does, and where the response is below half of the
/// median of its 5×5 neighbourhood. Empty for an empty flat.
Image<std::uint8_t> find_dead_pixels(const Image<float>& flat);

}  // namespace curlew
