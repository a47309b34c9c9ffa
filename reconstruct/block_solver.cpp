// Highway compiles this file once for every instruction set and chooses one at run time.
#include "reconstruct/block_solver.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "reconstruct/block_solver.cpp"
#include "hwy/foreach_target.h"
// Highway needs foreach_target.h before the header below.

#include <algorithm>
#include <cstring>

#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace curlew::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::CappedTag<float, 16>;
using V = hn::Vec<D>;
constexpr D d;

/// Computes kVectors vectors of out = matrix·in. Several columns are summed side by side, because
/// an addition takes some time to be ready for the next.
template <std::size_t kVectors>
HWY_INLINE void multiply_rows(const float* matrix, std::size_t stride, std::size_t columns,
                              const float* in, float* out) {
  constexpr std::size_t kAside = 8 / kVectors;
  const std::size_t lanes = hn::Lanes(d);
  V sum[kAside][kVectors];
  for (auto& aside : sum)
    for (V& vector : aside) vector = hn::Zero(d);
  std::size_t column = 0;
  for (; column + kAside <= columns; column += kAside) {
    for (std::size_t i = 0; i < kAside; ++i) {
      const V x = hn::Set(d, in[column + i]);
      const float* values = matrix + (column + i) * stride;
      for (std::size_t v = 0; v < kVectors; ++v)
        sum[i][v] = hn::MulAdd(hn::Load(d, values + v * lanes), x, sum[i][v]);
    }
  }
  for (; column < columns; ++column) {
    const V x = hn::Set(d, in[column]);
    for (std::size_t v = 0; v < kVectors; ++v)
      sum[0][v] = hn::MulAdd(hn::Load(d, matrix + column * stride + v * lanes), x, sum[0][v]);
  }
  for (std::size_t v = 0; v < kVectors; ++v) {
    for (std::size_t i = 1; i < kAside; ++i) sum[0][v] = hn::Add(sum[0][v], sum[i][v]);
    hn::Store(sum[0][v], d, out + v * lanes);
  }
}

/// Computes out = matrix·in, where a column of the matrix is `stride` floats, a multiple of 16.
HWY_INLINE void multiply(const float* matrix, std::size_t stride, std::size_t columns,
                         const float* in, float* out) {
  const std::size_t lanes = hn::Lanes(d);
  std::size_t row = 0;
  for (; row + 4 * lanes <= stride; row += 4 * lanes)
    multiply_rows<4>(matrix + row, stride, columns, in, out + row);
  for (; row + 2 * lanes <= stride; row += 2 * lanes)
    multiply_rows<2>(matrix + row, stride, columns, in, out + row);
  for (; row < stride; row += lanes) multiply_rows<1>(matrix + row, stride, columns, in, out + row);
}

std::size_t padded(std::int32_t n) { return (static_cast<std::size_t>(n) + 15) / 16 * 16; }

void solve_up(const BlockSolver::Block* blocks, std::span<const std::int32_t> fronts,
              const std::int32_t* borders, const float* values, float* out, float* b) {
  for (const std::int32_t front : fronts) {
    const BlockSolver::Block& block = blocks[front];
    multiply(values + block.up, padded(block.border), static_cast<std::size_t>(block.pivots),
             b + block.first, out);
    const std::int32_t* border = borders + block.border_start;
    for (std::int32_t i = 0; i < block.border; ++i) b[border[i]] += out[i];
  }
}

void solve_down(const BlockSolver::Block* blocks, std::span<const std::int32_t> fronts,
                const std::int32_t* borders, const float* values, float* in, float* out, float* b) {
  for (std::size_t f = fronts.size(); f-- > 0;) {
    const BlockSolver::Block& block = blocks[fronts[f]];
    const auto pivots = static_cast<std::size_t>(block.pivots);
    std::memcpy(in, b + block.first, pivots * sizeof(float));
    const std::int32_t* border = borders + block.border_start;
    // Every row of Gᵀ adds up to 1. So x is taken relative to one border node's, and the rounding
    // of Gᵀ counts for the differences within a front, not for all that x is.
    const float level = block.border > 0 ? b[border[0]] : 0.0F;
    for (std::int32_t i = 0; i < block.border; ++i) in[block.pivots + i] = b[border[i]] - level;
    multiply(values + block.down, padded(block.pivots),
             pivots + static_cast<std::size_t>(block.border), in, out);
    for (std::size_t i = 0; i < pivots; ++i)
      b[static_cast<std::size_t>(block.first) + i] = out[i] + level;
  }
}

}  // namespace
}  // namespace curlew::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace curlew {

HWY_EXPORT(solve_up);
HWY_EXPORT(solve_down);

BlockSolver::Workspace::Workspace(const BlockSolver& solver) {
  std::size_t most = 0;
  for (const Block& block : solver.blocks_)
    most = std::max(most, as_size(block.pivots + block.border));
  in.resize(most + 16);
  out.resize(most + 16);
}

void BlockSolver::solve_up(std::span<const std::int32_t> fronts, Workspace& workspace,
                           float* b) const noexcept {
  HWY_DYNAMIC_DISPATCH(solve_up)
  (blocks_.data(), fronts, border_.data(), values_.data(), workspace.out.data(), b);
}

void BlockSolver::solve_down(std::span<const std::int32_t> fronts, Workspace& workspace,
                             float* b) const noexcept {
  HWY_DYNAMIC_DISPATCH(solve_down)
  (blocks_.data(), fronts, border_.data(), values_.data(), workspace.in.data(),
   workspace.out.data(), b);
}

void BlockSolver::solve(Workspace& workspace, float* b) const noexcept {
  solve_up(all_, workspace, b);
  solve_down(all_, workspace, b);
}

}  // namespace curlew
#endif  // HWY_ONCE
