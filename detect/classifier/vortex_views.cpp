#include "detect/classifier/vortex_views.h"

#include <algorithm>
#include <cmath>

#include "detect/circulation.h"

namespace curlew {
namespace {

constexpr float kBelievedPair = 0.5F;   // less likely pairs are not reported
constexpr float kSameVortex = 0.8F;     // pitches: vortices of one sign nearer are one
constexpr float kPairOrVortex = 0.75F;  // pitches: a vortex and a pair nearer are one or the other
constexpr float kAgree = 0.8F;          // pitches: nodes that see it here have a say in where
constexpr int kNear = 2;                // nodes along an axis, between views of one vortex

float distance_squared(const Vortex& a, const Vortex& b) noexcept {
  const float x = a.x - b.x;
  const float y = a.y - b.y;
  return x * x + y * y;
}

}  // namespace

VortexViews::VortexViews(int node_rows, int node_cols)
    : seen(std::size_t{3} * static_cast<std::size_t>(node_rows) *
           static_cast<std::size_t>(node_cols)),
      likely(seen.capacity()),
      seen_at(3 * node_rows, node_cols, -1) {}

void report_vortices(const CirculationMap& circulation, double min_probability, VortexViews& views,
                     VortexList& vortices) noexcept {
  FixedList<NodeVortex>& seen = views.seen;
  FixedList<std::int32_t>& likely = views.likely;
  const int node_rows = circulation.value.rows();
  const int node_cols = circulation.value.cols();
  const auto index_at = [&](int charge, int row, int col) -> std::int32_t& {
    return views.seen_at((charge + 1) * node_rows + row, col);
  };
  const auto minimum = static_cast<float>(min_probability);
  likely.clear();
  for (std::size_t i = 0; i < seen.size(); ++i) {
    const Vortex& vortex = seen[i].vortex;
    const auto index = static_cast<std::int32_t>(i);
    index_at(vortex.charge, seen[i].row, seen[i].col) = index;
    if (vortex.probability >= minimum &&
        (vortex.charge != 0 || vortex.probability >= kBelievedPair))
      likely.push(index);
  }
  std::sort(likely.begin(), likely.end(), [&](std::int32_t a, std::int32_t b) {
    const float p = seen[static_cast<std::size_t>(a)].vortex.probability;
    const float q = seen[static_cast<std::size_t>(b)].vortex.probability;
    return p != q ? p > q : a < b;
  });
  const auto for_each_near = [&](const NodeVortex& view, int charge, auto&& use) {
    const int last_row = std::min(view.row + kNear, node_rows - 1);
    const int last_col = std::min(view.col + kNear, node_cols - 1);
    for (int r = std::max(view.row - kNear, 0); r <= last_row; ++r) {
      for (int c = std::max(view.col - kNear, 0); c <= last_col; ++c) {
        const std::int32_t i = index_at(charge, r, c);
        if (i >= 0) use(seen[static_cast<std::size_t>(i)]);
      }
    }
  };
  for (const std::int32_t index : likely) {
    NodeVortex& view = seen[static_cast<std::size_t>(index)];
    const int charge = view.vortex.charge;
    bool first = true;
    float weights = 0.0F, x = 0.0F, y = 0.0F;
    for_each_near(view, charge, [&](const NodeVortex& other) {
      const float apart = distance_squared(view.vortex, other.vortex);
      first &= !(other.precision < 0.0F && apart < kSameVortex * kSameVortex);
      if (apart > kAgree * kAgree) return;
      const float weight = other.vortex.probability * std::abs(other.precision);
      weights += weight;
      x += weight * other.vortex.x;
      y += weight * other.vortex.y;
    });
    const auto give_way = [&](const NodeVortex& other) {
      const float apart = distance_squared(view.vortex, other.vortex);
      first &= !(other.precision < 0.0F && apart < kPairOrVortex * kPairOrVortex);
    };
    if (charge != 0) {
      for_each_near(view, 0, give_way);
    } else {
      for_each_near(view, 1, give_way);
      for_each_near(view, -1, give_way);
    }
    if (!first) continue;
    Vortex vortex = view.vortex;
    vortex.x = std::clamp(x / weights, 0.0F, static_cast<float>(node_cols));
    vortex.y = std::clamp(y / weights, 0.0F, static_cast<float>(node_rows));
    for_each_near(view, charge, [&](const NodeVortex& other) {
      first &= !(other.precision < 0.0F &&
                 distance_squared(vortex, other.vortex) < kSameVortex * kSameVortex);
    });
    if (!first) continue;
    vortex.circulation = circulation.value(view.row, view.col);
    vortex.significance =
        significance(vortex.circulation, circulation.variance(view.row, view.col));
    vortices.push(vortex);
    view.vortex = vortex;
    view.precision = -view.precision;  // reported
  }
  for (const NodeVortex& view : seen) index_at(view.vortex.charge, view.row, view.col) = -1;
}

}  // namespace curlew
