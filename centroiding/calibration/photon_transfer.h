// This file declares photon transfer: how the noise of a stack of frames grows with its light tells
// what a unit of the file is worth in electrons.
#pragma once

#include <cstdint>

#include "core/image.h"
#include "core/optics.h"

namespace curlew {

/// This is what the variance v of pixels over frames tells, v = noise² + m / e_per_adu + c·m² (J.
/// R. Janesick, Photon Transfer, 2007, ch. 5), where m is a pixel's light. The last term takes up a
/// light that flickers and spots that move.
struct PhotonTransfer {
  double e_per_adu = kUnknown;  ///< NaN where noise does not grow significantly with the light
  double noise_adu = kUnknown;  ///< noise of a pixel without light; NaN where it cannot be told
  bool clipped = false;         ///< true if many pixels rest at one lowest value
};

/// Returns the mean of a sample variance over its median, for `frames` frames of normal noise.
double mean_of_median_variance(int frames);

/// Fits the variance against the light. `light_adu` is the mean over `frames` frames, less dark or
/// background, `variance_adu2` the sample variance; both are [rows, cols], and pixels that are not
/// finite are left out, as are those that `bad` marks (1, or an empty map) and those that are
/// clipped at the lowest or highest value. All is NaN for a stack of fewer than two frames.
PhotonTransfer measure_photon_transfer(const Image<float>& light_adu,
                                       const Image<float>& variance_adu2, int frames,
                                       const Image<std::uint8_t>& bad);

}  // namespace curlew
