// Spot pictures: a reference frame made fit for looking for spots.
#pragma once

#include <cstdint>
#include <vector>

#include "core/image.h"

namespace curlew {

/// The value below which `fraction` of `values` lie; 0 for none. Reorders its copy only.
double quantile(std::vector<float> values, double fraction);

/// A frame without its bad and hot pixels, with first estimates of background and noise.
struct SpotPicture {
  Image<float> pixels_adu;      ///< bad and lone hot pixels replaced by their neighbours
  double background_adu = 0.0;  ///< a low quantile: spots may cover most of the frame
  double noise_adu = 0.0;       ///< of one pixel; an upper bound where spots cover the frame
};

/// Throws Failure where fewer than half of the pixels are usable, where all hold one value, or
/// where most are saturated.
SpotPicture clean_spot_picture(const Image<float>& reference_adu,
                               const Image<std::uint8_t>& bad_pixel);

/// Replaces pixels that are bad or not finite by the mean of good neighbours, from the rim of a
/// bad patch inwards; `background` deep inside. bad_pixel may be empty.
void fill_bad_pixels(Image<float>& image, const Image<std::uint8_t>& bad_pixel, float background);

/// Convolution with a Gaussian; at the rim with what is left of it, renormalised.
Image<float> smooth_gaussian(const Image<float>& in, double sigma_px);

}  // namespace curlew
