#include "detect/classifier/vortex_views.h"

#include <algorithm>
#include <bit>

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

// The lower half of a key of VortexViews::likely.
constexpr std::uint64_t kIndexBits = 0xFFFFFFFFU;

/// Returns a key by which surer views come first, and of two as sure the one that was seen first.
/// The bits of floats that are not negative are in the order of the floats.
std::uint64_t key_of(float probability, std::size_t index) noexcept {
  return std::uint64_t{~std::bit_cast<std::uint32_t>(probability)} << 32U | index;
}

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

  /// Fills views.seen_at and views.is_seen.
  void enter_views() noexcept {
    for (std::size_t i = 0; i < views_.seen.size(); ++i) {
      const NodeVortex& view = views_.seen[i];
      const int row = row_of(view.vortex.charge, view.row);
      views_.seen_at(row, view.col) = static_cast<std::int32_t>(i);
      set_bit(views_.is_seen, row, view.col);
    }
  }

  /// Fills views.likely, the surest view first.
  void choose_likely(float min_probability) noexcept {
    const FixedList<NodeVortex>& seen = views_.seen;
    views_.likely.clear();
    for (std::size_t i = 0; i < seen.size(); ++i) {
      const Vortex& vortex = seen[i].vortex;
      if (vortex.probability >= min_probability &&
          (vortex.charge != 0 || vortex.probability >= kBelievedPair))
        views_.likely.push(key_of(vortex.probability, i));
    }
    std::sort(views_.likely.begin(), views_.likely.end());
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
    set_bit(views_.is_reported, row_of(charge, view.row), view.col);
  }

  /// Empties the bits again.
  void remove_views() noexcept {
    views_.is_seen.fill(0);
    views_.is_reported.fill(0);
  }

 private:
  int row_of(int charge, int row) const noexcept { return (charge + 1) * node_rows_ + row; }

  static void set_bit(Image<std::uint64_t>& bits, int row, int col) noexcept {
    const auto bit = static_cast<unsigned>(col + kNear);
    bits(row, static_cast<int>(bit / 64)) |= std::uint64_t{1} << bit % 64;
  }

  /// Calls `use` for all views of this charge from the nodes near the view's that have their bit.
  template <typename Use>
  void for_each_near(const NodeVortex& view, int charge, const Image<std::uint64_t>& bits,
                     Use&& use) const noexcept {
    constexpr std::uint64_t kWidth = 2 * kNear + 1;
    const int first_col = view.col - kNear;
    const auto shift = static_cast<unsigned>(view.col) % 64;
    const int last_row = std::min(view.row + kNear, node_rows_ - 1);
    for (int r = std::max(view.row - kNear, 0); r <= last_row; ++r) {
      const int row = row_of(charge, r);
      const std::uint64_t* const words = &bits(row, view.col / 64);
      std::uint64_t near =
          (words[0] >> shift | words[1] << 1 << (63 - shift)) & ((std::uint64_t{1} << kWidth) - 1);
      for (; near != 0; near &= near - 1) {
        const std::int32_t i = views_.seen_at(row, first_col + std::countr_zero(near));
        use(views_.seen[static_cast<std::size_t>(i)]);
      }
    }
  }

  /// Returns whether something of this charge has been reported from a node near the view's, less
  /// than `radius` from the vortex.
  bool reported_near(const NodeVortex& view, const Vortex& vortex, int charge,
                     float radius) const noexcept {
    bool reported = false;
    for_each_near(view, charge, views_.is_reported, [&](const NodeVortex& other) {
      reported |= distance_squared(vortex, other.vortex) < radius * radius;
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
    for_each_near(view, view.vortex.charge, views_.is_seen, [&](const NodeVortex& other) {
      if (distance_squared(view.vortex, other.vortex) > kAgree * kAgree) return;
      const float weight = other.vortex.probability * other.precision;
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
      seen_at(3 * node_rows, node_cols),
      is_seen(3 * node_rows, (node_cols + 2 * kNear) / 64 + 2),
      is_reported(is_seen.rows(), is_seen.cols()) {}

void report_vortices(const CirculationMap& circulation, double min_probability, VortexViews& views,
                     VortexList& vortices) noexcept {
  ViewMerger merger(circulation, views);
  merger.enter_views();
  merger.choose_likely(static_cast<float>(min_probability));
  for (const std::uint64_t key : views.likely)
    merger.report(views.seen[static_cast<std::size_t>(key & kIndexBits)], vortices);
  merger.remove_views();
}

}  // namespace curlew
