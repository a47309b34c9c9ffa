#include "detect/classifier/lit_nodes.h"

#include <algorithm>

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

bool is_seen(const Centroids& centroids, float mean_flux_adu, int row, int col) noexcept {
  constexpr int kShadow = 2;
  constexpr int kMostUntold = 3;
  const int missing_in_array = count_round(row, col, 1, [&](int i, int j) {
    return centroids.state.contains(i, j) && is_gone(centroids, i, j);
  });
  if (missing_in_array == 0) return true;
  const bool by_shadow = missing_in_array >= kShadow;
  const auto untold = [&](int i, int j) {
    return by_shadow ? tells_nothing(centroids, kDark * mean_flux_adu, i, j)
                     : is_gone(centroids, i, j);
  };
  const int inner = count_round(row, col, 0, untold);
  return inner == 0 || (inner == 1 && count_round(row, col, 1, untold) <= kMostUntold);
}

bool is_seen(const Centroids& centroids, float mean_flux_adu, const Vortex& vortex) noexcept {
  const auto cell = [](float place, int lenslets) {
    return std::min(static_cast<int>(std::max(0.0F, std::min(place, 1e6F))), lenslets - 2);
  };
  return is_seen(centroids, mean_flux_adu, cell(vortex.y, centroids.state.rows()),
                 cell(vortex.x, centroids.state.cols()));
}

}  // namespace curlew
