// Loops: what slopes add up to round the corners of lenslets, and what a vortex makes of them.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>

#include "core/lattice.h"

namespace curlew {

inline constexpr int kLoopReach = 3;              // a vortex' loops: 2·kLoopReach cells square
inline constexpr int kLoopSide = 2 * kLoopReach;  // of these cells
using VortexLoops = std::array<float, std::size_t{kLoopSide} * kLoopSide>;

/// Loops round corners 00, 01, 10, 11 of a lenslet that its edges are part of, and in which sense.
/// Edge A, s_x + s_y, runs round corner 10 in the positive sense; edge B, s_y − s_x, round 00.
inline std::array<float, 4> along_corners(float x, float y) {
  const float a = x + y;
  const float b = y - x;
  return {b, -a, a, -b};
}

/// Calls use(corner, row and column in the square of cells) for the cells round a vortex that lie
/// on the array.
template <typename Use>
void for_each_cell(const Lattice& lattice, float x, float y, Use use) {
  const int top = static_cast<int>(std::floor(y + 0.5F)) - kLoopReach + 1;  // corners
  const int left = static_cast<int>(std::floor(x + 0.5F)) - kLoopReach + 1;
  for (int i = 0; i < kLoopSide; ++i) {
    for (int j = 0; j < kLoopSide; ++j) {
      if (top + i < 1 || top + i >= lattice.rows() || left + j < 1 || left + j >= lattice.cols())
        continue;
      use((top + i) * lattice.corner_cols() + left + j, i, j);
    }
  }
}

/// Loops of a vortex in the cells round it. They add up to 2π on each sublattice, the part of the
/// cells farther out included.
VortexLoops vortex_loops(float x, float y, float charge, float softening) noexcept;

}  // namespace curlew
