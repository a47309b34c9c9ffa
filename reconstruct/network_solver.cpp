// Solutions with the factor of one frame's weights. Highway compiles this file once for every
// instruction set and chooses one at run time.
#include "reconstruct/network_factor.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "reconstruct/network_solver.cpp"
#include "hwy/foreach_target.h"
// Highway needs foreach_target.h before the header below.

#include <algorithm>
#include <cstring>

#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace curlew::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::CappedTag<float, NetworkFactor::kLanes>;
using V = hn::Vec<D>;
constexpr D d;
constexpr std::size_t kLanes = NetworkFactor::kLanes;

/// This is one batch of tiles, and b at their nodes, [node, lane].
struct TileBatch {
  TileBatch(const NetworkFactor::Steps& all_steps, const NetworkFactor::Workspace& ws,
            std::size_t batch)
      : steps(all_steps),
        entries(ws.tiles.data() + batch * static_cast<std::size_t>(all_steps.entries) * kLanes),
        scales(ws.tile_scales.data() + batch * TileShape::kInside * kLanes),
        position(all_steps.tile_position.data() + batch * TileShape::kNodes * kLanes) {}

  const NetworkFactor::Steps& steps;
  const float* entries;
  const float* scales;
  const std::int32_t* position;
  HWY_ALIGN float values[TileShape::kNodes * kLanes];

  float* at(std::size_t node) { return values + node * kLanes; }
};

constexpr std::size_t kInsideValues = std::size_t{TileShape::kInside} * kLanes;
constexpr std::size_t kAllValues = std::size_t{TileShape::kNodes} * kLanes;

/// Does b ← L⁻¹·b for the nodes inside the tiles, and passes the rest to the border.
void tiles_up(TileBatch& batch, float* b) {
  for (std::size_t i = 0; i < kInsideValues; ++i) batch.values[i] = b[batch.position[i]];
  std::fill(batch.values + kInsideValues, batch.values + kAllValues, 0.0F);
  for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(d)) {
    for (std::size_t i = 0; i < TileShape::kInside; ++i) {
      const NetworkFactor::TilePivot& pivot = batch.steps.pivots[i];
      const V y =
          hn::Mul(hn::Load(d, batch.at(i) + lane), hn::Load(d, batch.scales + i * kLanes + lane));
      hn::Store(y, d, batch.at(i) + lane);
      const auto end = static_cast<std::size_t>(pivot.first) + static_cast<std::size_t>(pivot.size);
      for (auto e = static_cast<std::size_t>(pivot.first); e < end; ++e) {
        float* to = batch.at(static_cast<std::size_t>(batch.steps.entry_row[e])) + lane;
        const V factor = hn::Load(d, batch.entries + e * kLanes + lane);
        hn::Store(hn::MulAdd(factor, y, hn::Load(d, to)), d, to);
      }
    }
  }
  for (std::size_t i = 0; i < kInsideValues; ++i) b[batch.position[i]] = batch.values[i];
  for (std::size_t i = kInsideValues; i < kAllValues; ++i) b[batch.position[i]] += batch.values[i];
}

/// Does x = L⁻ᵀ·y for the nodes inside the tiles, from x at the border.
void tiles_down(TileBatch& batch, float* b) {
  for (std::size_t i = 0; i < kAllValues; ++i) batch.values[i] = b[batch.position[i]];
  for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(d)) {
    for (std::size_t i = TileShape::kInside; i-- > 0;) {
      const NetworkFactor::TilePivot& pivot = batch.steps.pivots[i];
      V sum = hn::Load(d, batch.at(i) + lane);
      const auto end = static_cast<std::size_t>(pivot.first) + static_cast<std::size_t>(pivot.size);
      for (auto e = static_cast<std::size_t>(pivot.first); e < end; ++e) {
        const float* from = batch.at(static_cast<std::size_t>(batch.steps.entry_row[e])) + lane;
        sum = hn::MulAdd(hn::Load(d, batch.entries + e * kLanes + lane), hn::Load(d, from), sum);
      }
      hn::Store(hn::Mul(sum, hn::Load(d, batch.scales + i * kLanes + lane)), d, batch.at(i) + lane);
    }
  }
  for (std::size_t i = 0; i < kInsideValues; ++i) b[batch.position[i]] = batch.values[i];
}

/// Does the same for a front on a line. `values` are b at its nodes and its border.
void line_up(const NetworkFactor::LineFront& line, const std::int32_t* border, const float* panel,
             const float* scales, float* values, float* b) {
  const std::size_t lanes = hn::Lanes(d);
  const auto stride = static_cast<std::size_t>(line.stride);
  const auto pivots = static_cast<std::size_t>(line.pivots);
  std::memset(values, 0, stride * sizeof(float));
  std::memcpy(values, b + line.first, pivots * sizeof(float));
  for (std::size_t j = 0; j < pivots; ++j) {
    const float y = values[j] * scales[j];
    b[static_cast<std::size_t>(line.first) + j] = y;
    const V factor = hn::Set(d, y);
    const float* column = panel + j * stride;
    for (std::size_t i = j / lanes * lanes; i < stride; i += lanes)
      hn::Store(hn::MulAdd(factor, hn::Load(d, column + i), hn::Load(d, values + i)), d,
                values + i);
  }
  for (std::int32_t i = 0; i < line.border; ++i)
    b[border[i]] += values[pivots + static_cast<std::size_t>(i)];
}

void line_down(const NetworkFactor::LineFront& line, const std::int32_t* border, const float* panel,
               const float* scales, float* values, float* b) {
  const std::size_t lanes = hn::Lanes(d);
  const auto stride = static_cast<std::size_t>(line.stride);
  const auto pivots = static_cast<std::size_t>(line.pivots);
  std::memset(values, 0, stride * sizeof(float));
  for (std::int32_t i = 0; i < line.border; ++i)
    values[pivots + static_cast<std::size_t>(i)] = b[border[i]];
  for (std::size_t j = pivots; j-- > 0;) {
    const float* column = panel + j * stride;
    V sum = hn::Zero(d);
    for (std::size_t i = j / lanes * lanes; i < stride; i += lanes)
      sum = hn::MulAdd(hn::Load(d, column + i), hn::Load(d, values + i), sum);
    const std::size_t at = static_cast<std::size_t>(line.first) + j;
    b[at] = values[j] = (b[at] + hn::GetLane(hn::SumOfLanes(d, sum))) * scales[j];
  }
}

void solve(const NetworkFactor::Steps& steps, NetworkFactor::Workspace& ws, float* b) {
  const auto n_batches = static_cast<std::size_t>(steps.batches);
  float* outside = b + steps.nodes;  // Lanes without a node read and write here.
  for (std::size_t i = 0; i < n_batches; ++i) {
    TileBatch batch(steps, ws, i);
    tiles_up(batch, b);
    *outside = 0.0F;
  }
  for (const NetworkFactor::LineFront& line : steps.lines)
    line_up(line, steps.borders.data() + line.first_border, ws.panels.data() + line.panel,
            ws.scales.data() + line.first, ws.vector.data(), b);
  for (std::size_t l = steps.lines.size(); l-- > 0;) {
    const NetworkFactor::LineFront& line = steps.lines[l];
    line_down(line, steps.borders.data() + line.first_border, ws.panels.data() + line.panel,
              ws.scales.data() + line.first, ws.vector.data(), b);
  }
  for (std::size_t i = 0; i < n_batches; ++i) {
    TileBatch batch(steps, ws, i);
    tiles_down(batch, b);
    *outside = 0.0F;
  }
}

}  // namespace
}  // namespace curlew::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace curlew {

HWY_EXPORT(solve);

void NetworkFactor::solve(Workspace& workspace, float* b) const noexcept {
  HWY_DYNAMIC_DISPATCH(solve)(steps_, workspace, b);
}

}  // namespace curlew
#endif  // HWY_ONCE
