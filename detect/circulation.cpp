#include "detect/circulation.h"

#include <algorithm>
#include <bit>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "core/size_check.h"

namespace curlew {
namespace {

/// Holds pointers into the maps of one row of lenslets.
struct LensletRow {
  LensletRow(const SlopeField& slopes, int row)
      : x(&slopes.x(row, 0)),
        y(&slopes.y(row, 0)),
        variance_x(&slopes.variance_x(row, 0)),
        variance_y(&slopes.variance_y(row, 0)),
        covariance(&slopes.covariance_xy(row, 0)),
        valid(&slopes.valid(row, 0)) {}

  const float* x;
  const float* y;
  const float* variance_x;
  const float* variance_y;
  const float* covariance;
  const std::uint8_t* valid;
};

/// Returns `value` where `valid` is 1, and 0 where it is 0. It masks the bits, because a
/// conditional would let the compiler skip the arithmetic, and then the compiler makes no vectors.
float keep_if(std::uint8_t valid, float value) noexcept {
  return std::bit_cast<float>(std::bit_cast<std::uint32_t>(value) & (0U - valid));
}

// The three loops are plain, each over few arrays and without a branch, so that the compiler makes
// vectors of them. In D a lenslet at (r,c) or (r+1,c+1) takes part with ±½(s_x − s_y), and one at
// (r,c+1) or (r+1,c) with ±½(s_x + s_y). The signs of the covariances follow from this.
int circulate_row(const LensletRow& upper, const LensletRow& lower, std::size_t cells,
                  float* __restrict value, float* __restrict variance,
                  std::uint8_t* __restrict valid) noexcept {
  int n_valid = 0;
  for (std::size_t c = 0; c < cells; ++c) {
    const bool whole = (upper.valid[c] != 0) & (upper.valid[c + 1] != 0) & (lower.valid[c] != 0) &
                       (lower.valid[c + 1] != 0);
    valid[c] = whole ? 1 : 0;
    n_valid += whole ? 1 : 0;
  }
  for (std::size_t c = 0; c < cells; ++c) {
    const float d = 0.5F * ((upper.x[c] - upper.y[c]) + (upper.x[c + 1] + upper.y[c + 1]) +
                            (lower.y[c + 1] - lower.x[c + 1]) - (lower.x[c] + lower.y[c]));
    value[c] = keep_if(valid[c], d);
  }
  for (std::size_t c = 0; c < cells; ++c) {
    const float v = 0.25F * ((upper.variance_x[c] + upper.variance_y[c]) +
                             (upper.variance_x[c + 1] + upper.variance_y[c + 1]) +
                             (lower.variance_x[c] + lower.variance_y[c]) +
                             (lower.variance_x[c + 1] + lower.variance_y[c + 1])) -
                    0.5F * ((upper.covariance[c] - upper.covariance[c + 1]) +
                            (lower.covariance[c + 1] - lower.covariance[c]));
    variance[c] = keep_if(valid[c], v);
  }
  return n_valid;
}

}  // namespace

int circulate_rows(const SlopeField& slopes, int first, int last, CirculationMap& map) noexcept {
  check_size("circulate", "circulation", size_of(map.value),
             {slopes.rows() - 1, slopes.cols() - 1});
  assert(0 <= first && last <= map.value.rows());
  const auto cells = static_cast<std::size_t>(map.value.cols());
  int n_valid = 0;
  for (int r = first; r < last; ++r) {
    n_valid += circulate_row(LensletRow(slopes, r), LensletRow(slopes, r + 1), cells,
                             &map.value(r, 0), &map.variance(r, 0), &map.valid(r, 0));
  }
  return n_valid;
}

void circulate(const SlopeField& slopes, CirculationMap& map) noexcept {
  map.n_valid = circulate_rows(slopes, 0, map.value.rows(), map);
}

float significance(float circulation_rad, float variance_rad2) noexcept {
  const float size = std::abs(circulation_rad);
  const float sigma = std::sqrt(std::max(variance_rad2, 0.0F));
  return size < kMaxSignificance * sigma ? size / sigma : kMaxSignificance;
}

}  // namespace curlew
