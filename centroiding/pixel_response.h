// This tells the pixels that hardly answer to light from the others.
#pragma once

#include <cstdint>

#include "core/image.h"

namespace curlew {

/// Returns 1 where a flat's response is no positive number, or is less than a tenth or more than
/// ten times the median of the positive ones: dividing by it would make noise, or nothing, of the
/// pixel. flat: [rows, cols]; so is the result.
Image<std::uint8_t> find_unresponsive_pixels(const Image<float>& flat);

/// Returns the median of the positive responses; NaN if there is none.
float median_response(const Image<float>& flat);

}  // namespace curlew
