#include "centroiding/pixel_response.h"

#include <cmath>
#include <span>
#include <vector>

#include "core/median.h"

namespace curlew {
namespace {

// Pixels of a good detector differ by a few per cent; vignetted corners keep a third.
constexpr float kLeast = 0.1F;

}  // namespace

float median_response(const Image<float>& flat) {
  std::vector<float> positive;
  for (const float response : flat)
    if (std::isfinite(response) && response > 0.0F) positive.push_back(response);
  return median_of(std::span(positive));
}

Image<std::uint8_t> find_unresponsive_pixels(const Image<float>& flat) {
  const float median = median_response(flat);
  Image<std::uint8_t> found(flat.rows(), flat.cols());
  for (std::size_t i = 0; i < flat.size(); ++i)
    found[i] = flat[i] >= kLeast * median && flat[i] <= median / kLeast ? 0 : 1;
  return found;
}

}  // namespace curlew
