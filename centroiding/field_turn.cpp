#include "centroiding/field_turn.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <span>

#include "core/as_size.h"
#include "core/median.h"
#include "core/size_check.h"

namespace curlew {
namespace {

/// Returns whether the median is surely not 0. A sign test says it without a median: for small
/// medians, it counts as many standard deviations as the median has of its own.
bool is_turned(const CellSample& sample) noexcept {
  constexpr float kSurely = 4.0F;
  if (sample.n < CellSample::kFewest) return false;
  std::size_t positive = 0;
  std::size_t negative = 0;
  for (const float circulation : sample.circulations()) {
    positive += circulation > 0.0F ? 1 : 0;
    negative += circulation < 0.0F ? 1 : 0;
  }
  return sigmas_from_half(std::max(positive, negative), sample.n) > kSurely;
}

}  // namespace

float subtract_turn(const Centroids& centroids, CellSample& sample, SlopeField& slopes) noexcept {
  check_size("subtract_turn", "centroids", size_of(centroids.state), size_of(slopes.x));
  if (!is_turned(sample)) return 0.0F;
  std::array<float, CellSample::kMost> values = sample.circulation_rad;
  const float median = median_of(std::span(values.data(), sample.n));
  for (float& circulation : sample.circulations()) circulation -= median;
  const float turn = 0.5F * median;
  const float middle_row = 0.5F * static_cast<float>(slopes.rows() - 1);
  const float middle_col = 0.5F * static_cast<float>(slopes.cols() - 1);
  for (int r = 0; r < slopes.rows(); ++r) {
    for (int c = 0; c < slopes.cols(); ++c) {
      const std::size_t k = as_size(r) * as_size(slopes.cols()) + as_size(c);
      const bool is_dark =
          centroids.state[k] == LensletState::kFaint && !(centroids.flux_adu[k] > 0.0F);
      if (slopes.valid[k] == 0 || is_dark) continue;
      slopes.x[k] += turn * (static_cast<float>(r) - middle_row);
      slopes.y[k] -= turn * (static_cast<float>(c) - middle_col);
    }
  }
  return turn;
}

}  // namespace curlew
