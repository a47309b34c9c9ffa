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

constexpr std::size_t kMaxSample = 400;  // cells
constexpr std::size_t kMinSample = 40;

/// Gathers the circulation of cells that are spread over the array, and returns how many there are.
std::size_t sample_circulation(const Centroids& centroids, const SlopeField& slopes,
                               std::array<float, kMaxSample>& circulation_rad) noexcept {
  const std::size_t rows = as_size(slopes.rows()), cols = as_size(slopes.cols());
  if (rows < 2 || cols < 2) return 0;
  const std::size_t cells = (rows - 1) * (cols - 1);
  const std::size_t stride = (cells - 1) / kMaxSample + 1;
  std::size_t n = 0;
  for (std::size_t r = 0; r + 1 < rows; ++r) {
    // The sample begins a cell further on in each row, so that it is spread over all columns.
    for (std::size_t c = (r * (cols - 1) + r) % stride; c + 1 < cols && n < kMaxSample;
         c += stride) {
      const std::size_t k = r * cols + c;
      const std::array<std::size_t, 4> around{k, k + 1, k + cols, k + cols + 1};
      if (!std::all_of(around.begin(), around.end(), [&](std::size_t lenslet) {
            return centroids.state[lenslet] == LensletState::kValid;
          }))
        continue;
      const auto [a, b, d, e] = around;
      circulation_rad[n++] = 0.5F * (slopes.x[a] + slopes.x[b] + slopes.y[b] + slopes.y[e] -
                                     slopes.x[d] - slopes.x[e] - slopes.y[a] - slopes.y[d]);
    }
  }
  return n;
}

}  // namespace

float subtract_turn(const Centroids& centroids, SlopeField& slopes) noexcept {
  check_size("subtract_turn", "centroids", size_of(centroids.state), size_of(slopes.x));
  constexpr float kSurely = 4.0F;               // times the median's own error
  constexpr float kErrorOfMedian = 1.2533F;     // of a normal distribution, where a mean's is 1
  constexpr float kSigmaOfDeviation = 1.4826F;  // over the median deviation
  std::array<float, kMaxSample> sample;
  const std::size_t n = sample_circulation(centroids, slopes, sample);
  if (n < kMinSample) return 0.0F;
  const std::span<float> values(sample.data(), n);
  const float median = median_of(values);
  for (float& value : values) value = std::abs(value - median);
  const float sigma = kSigmaOfDeviation * median_of(values);
  const float error = kErrorOfMedian * sigma / std::sqrt(static_cast<float>(n));
  if (!(std::abs(median) > kSurely * error)) return 0.0F;
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
