#include "detect/classifier/vortex_views.h"

#include <algorithm>
#include <cmath>

#include "detect/circulation.h"

namespace curlew {
namespace {

// Pairs that are less likely than this are not reported.
constexpr float kBelievedPair = 0.5F;
// Two vortices of one sign that are nearer each other than this many pitches are one vortex.
constexpr float kSameVortex = 0.8F;
// A vortex and a pair that are nearer each other than this many pitches are one or the other.
constexpr float kPairOrVortex = 0.75F;
// Views within this many pitches of a view count in the mean of its position.
constexpr float kAgree = 0.8F;
// The nodes of two views of one vortex are at most this many nodes apart along an axis.
constexpr int kNear = 2;

float distance_squared(const Vortex& a, const Vortex& b) noexcept {
  const float x = a.x - b.x;
  const float y = a.y - b.y;
  return x * x + y * y;
}

/// Merges the views of one frame into vortices.
class ViewMerger {
 public:
  ViewMerger(const CirculationMap& circulation, VortexViews& views) noexcept
      : circulation_(circulation),
        views_(views),
        node_rows_(circulation.value.rows()),
        node_cols_(circulation.value.cols()) {}

  /// Fills views.seen_at.
  void enter_views() noexcept {
    for (std::size_t i = 0; i < views_.seen.size(); ++i)
      index_of(views_.seen[i]) = static_cast<std::int32_t>(i);
  }

  /// Fills views.likely, the surest view first.
  void choose_likely(float min_probability) noexcept {
    const FixedList<NodeVortex>& seen = views_.seen;
    views_.likely.clear();
    for (std::size_t i = 0; i < seen.size(); ++i) {
      const Vortex& vortex = seen[i].vortex;
      if (vortex.probability >= min_probability &&
          (vortex.charge != 0 || vortex.probability >= kBelievedPair))
        views_.likely.push(static_cast<std::int32_t>(i));
    }
    std::sort(views_.likely.begin(), views_.likely.end(), [&](std::int32_t a, std::int32_t b) {
      const float p = seen[static_cast<std::size_t>(a)].vortex.probability;
      const float q = seen[static_cast<std::size_t>(b)].vortex.probability;
      return p != q ? p > q : a < b;
    });
  }

  /// Reports the view's vortex, unless one that has been reported rules it out.
  void report(NodeVortex& view, VortexList& vortices) noexcept {
    const int charge = view.vortex.charge;
    if (reported_near(view, view.vortex, charge, kSameVortex) || is_pair_or_vortex(view)) return;
    Vortex vortex = at_mean_position(view);
    if (reported_near(view, vortex, charge, kSameVortex)) return;
    if (circulation_.valid(view.row, view.col) != 0) {
      vortex.circulation = circulation_.value(view.row, view.col);
      vortex.significance =
          significance(vortex.circulation, circulation_.variance(view.row, view.col));
    }
    vortices.push(vortex);
    view.vortex = vortex;
    view.precision = -view.precision;  // A negative precision marks what has been reported.
  }

  /// Empties views.seen_at again.
  void remove_views() noexcept {
    for (const NodeVortex& view : views_.seen) index_of(view) = -1;
  }

 private:
  std::int32_t& index_at(int charge, int row, int col) const noexcept {
    return views_.seen_at((charge + 1) * node_rows_ + row, col);
  }
  std::int32_t& index_of(const NodeVortex& view) const noexcept {
    return index_at(view.vortex.charge, view.row, view.col);
  }

  /// Calls `use` for all views of this charge from the nodes near the view's.
  template <typename Use>
  void for_each_near(const NodeVortex& view, int charge, Use&& use) const noexcept {
    const int last_row = std::min(view.row + kNear, node_rows_ - 1);
    const int last_col = std::min(view.col + kNear, node_cols_ - 1);
    for (int row = std::max(view.row - kNear, 0); row <= last_row; ++row) {
      for (int col = std::max(view.col - kNear, 0); col <= last_col; ++col) {
        const std::int32_t i = index_at(charge, row, col);
        if (i >= 0) use(views_.seen[static_cast<std::size_t>(i)]);
      }
    }
  }

  /// Returns whether something of this charge has been reported from a node near the view's, less
  /// than `radius` from the vortex.
  bool reported_near(const NodeVortex& view, const Vortex& vortex, int charge,
                     float radius) const noexcept {
    bool reported = false;
    for_each_near(view, charge, [&](const NodeVortex& other) {
      reported |=
          other.precision < 0.0F && distance_squared(vortex, other.vortex) < radius * radius;
    });
    return reported;
  }

  /// Returns whether a pair has been reported where the view sees a vortex, or a vortex where it
  /// sees a pair.
  bool is_pair_or_vortex(const NodeVortex& view) const noexcept {
    const Vortex& vortex = view.vortex;
    if (vortex.charge != 0) return reported_near(view, vortex, 0, kPairOrVortex);
    return reported_near(view, vortex, 1, kPairOrVortex) ||
           reported_near(view, vortex, -1, kPairOrVortex);
  }

  /// Returns the view's vortex at the mean position of all views that agree with it.
  Vortex at_mean_position(const NodeVortex& view) const noexcept {
    float weights = 0.0F, x = 0.0F, y = 0.0F;
    for_each_near(view, view.vortex.charge, [&](const NodeVortex& other) {
      if (distance_squared(view.vortex, other.vortex) > kAgree * kAgree) return;
      const float weight = other.vortex.probability * std::abs(other.precision);
      weights += weight;
      x += weight * other.vortex.x;
      y += weight * other.vortex.y;
    });
    Vortex vortex = view.vortex;
    vortex.x = std::clamp(x / weights, 0.0F, static_cast<float>(node_cols_));
    vortex.y = std::clamp(y / weights, 0.0F, static_cast<float>(node_rows_));
    return vortex;
  }

  const CirculationMap& circulation_;
  VortexViews& views_;
  int node_rows_;
  int node_cols_;
};

}  // namespace

VortexViews::VortexViews(int node_rows, int node_cols)
    : seen(std::size_t{3} * static_cast<std::size_t>(node_rows) *
           static_cast<std::size_t>(node_cols)),
      likely(seen.capacity()),
      seen_at(3 * node_rows, node_cols, -1) {}

void report_vortices(const CirculationMap& circulation, double min_probability, VortexViews& views,
                     VortexList& vortices) noexcept {
  ViewMerger merger(circulation, views);
  merger.enter_views();
  merger.choose_likely(static_cast<float>(min_probability));
  for (const std::int32_t index : views.likely)
    merger.report(views.seen[static_cast<std::size_t>(index)], vortices);
  merger.remove_views();
}

}  // namespace curlew
