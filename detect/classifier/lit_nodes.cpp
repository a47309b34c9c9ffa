#include "detect/classifier/lit_nodes.h"

#include <algorithm>
#include <cstddef>

#include "detect/classifier/vortex_scout.h"

namespace curlew {
namespace {

constexpr float kDark = 0.05F;  // of the mean flux, as the network was taught

bool is_gone(const Centroids& centroids, int row, int col) noexcept {
  return !centroids.state.contains(row, col) || is_missing(centroids.state(row, col));
}

/// Returns whether a lenslet is missing, or dark without most of those round it being lit.
bool tells_nothing(const Centroids& centroids, float dark_adu, int row, int col) noexcept {
  if (is_gone(centroids, row, col)) return true;
  if (centroids.flux_adu(row, col) >= dark_adu) return false;
  int around = -1;  // without itself, which is dark
  int lit = 0;
  for (int i = row - 1; i <= row + 1; ++i) {
    for (int j = col - 1; j <= col + 1; ++j) {
      if (!centroids.state.contains(i, j)) continue;
      ++around;
      lit += !is_gone(centroids, i, j) && centroids.flux_adu(i, j) >= dark_adu ? 1 : 0;
    }
  }
  return 2 * lit <= around;
}

/// Counts lenslets round a node, out to `margin` beyond its four.
template <typename Counts>
int count_round(int row, int col, int margin, Counts counts) noexcept {
  int n = 0;
  for (int i = row - margin; i <= row + 1 + margin; ++i)
    for (int j = col - margin; j <= col + 1 + margin; ++j) n += counts(i, j) ? 1 : 0;
  return n;
}

}  // namespace

LitNodes::LitNodes(int rows, int cols)
    : gone_(rows + 2, cols + 2), in_row_(rows + 2, cols - 1), missing_(rows - 1, cols - 1) {}

void LitNodes::look_at(const Centroids& centroids, float mean_flux_adu) noexcept {
  centroids_ = &centroids;
  dark_adu_ = kDark * mean_flux_adu;
  const int rows = centroids.state.rows(), cols = centroids.state.cols();
  for (int r = 0; r < rows; ++r) {
    const LensletState* const state = &centroids.state(r, 0);
    std::uint8_t* const gone = &gone_(r + 1, 1);
    for (int c = 0; c < cols; ++c) gone[c] = is_missing(state[c]) ? 1 : 0;
  }
  const auto sum_four = [](const std::uint8_t* from, std::ptrdiff_t step, int n, std::uint8_t* to) {
    for (int i = 0; i < n; ++i)
      to[i] = static_cast<std::uint8_t>(from[i] + from[i + step] + from[i + 2 * step] +
                                        from[i + 3 * step]);
  };
  for (int r = 0; r < rows + 2; ++r) sum_four(&gone_(r, 0), 1, cols - 1, &in_row_(r, 0));
  for (int r = 0; r + 1 < rows; ++r)
    sum_four(&in_row_(r, 0), in_row_.cols(), cols - 1, &missing_(r, 0));
}

bool LitNodes::is_seen(int row, int col) const noexcept {
  constexpr int kShadow = 2;
  constexpr int kMostUntold = 3;
  const int missing_in_array = missing_(row, col);
  if (missing_in_array == 0) return true;
  const bool by_shadow = missing_in_array >= kShadow;
  const auto untold = [&](int i, int j) {
    return by_shadow ? tells_nothing(*centroids_, dark_adu_, i, j) : is_gone(*centroids_, i, j);
  };
  const int inner = count_round(row, col, 0, untold);
  return inner == 0 || (inner == 1 && count_round(row, col, 1, untold) <= kMostUntold);
}

bool LitNodes::is_seen(const Vortex& vortex) const noexcept {
  const auto cell = [](float place, int lenslets) {
    return std::min(static_cast<int>(std::max(0.0F, std::min(place, 1e6F))), lenslets - 2);
  };
  return is_seen(cell(vortex.y, centroids_->state.rows()),
                 cell(vortex.x, centroids_->state.cols()));
}

}  // namespace curlew
