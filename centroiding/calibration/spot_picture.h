// This file declares spot pictures: reference frames made fit for finding spots.
#pragma once

#include <cstdint>
#include <vector>

#include "core/image.h"

namespace curlew {

/// Returns the value below which `fraction` of `values` lie, and 0 where there are none. Only the
/// function's own copy is reordered.
double quantile(std::vector<float> values, double fraction);

/// This is a frame without its bad and hot pixels, with first estimates of background and noise.
struct SpotPicture {
  Image<float> pixels_adu;      ///< bad and lone hot pixels replaced by their neighbours
  double background_adu = 0.0;  ///< a low quantile, because spots may cover most of the frame
  double noise_adu = 0.0;       ///< noise of one pixel; an upper bound where spots cover the frame
  double matters_adu = 0.0;     ///< a pixel must stand out by this much to be marked as hot
  Image<std::uint8_t> hot;      ///< 1 where a lone hot pixel was replaced
  Image<std::uint8_t> border;   ///< as find_borders() returns it
};

/// Returns 1 in the columns and rows at the frame's rim that hold no picture, as overscan does: of
/// each, the median lies farther out of the values in the frame's middle than these are wide. The
/// map is empty where there are none. They are at most a quarter of the frame on each side.
Image<std::uint8_t> find_borders(const Image<float>& reference_adu,
                                 const Image<std::uint8_t>& bad_pixel);

/// Cleans a frame. Throws Failure where fewer than half of the pixels are usable, where all hold
/// one value, or where most are saturated.
SpotPicture clean_spot_picture(const Image<float>& reference_adu,
                               const Image<std::uint8_t>& bad_pixel);

/// Replaces pixels that are bad or not finite by the mean of their good neighbours, from the rim of
/// a bad patch inwards. Deep inside, `background` replaces them. bad_pixel may be empty.
void fill_bad_pixels(Image<float>& image, const Image<std::uint8_t>& bad_pixel, float background);

/// Convolves an image with a Gaussian. At the rim the rest of the Gaussian is renormalised.
Image<float> smooth_gaussian(const Image<float>& in, double sigma_px);

}  // namespace curlew
