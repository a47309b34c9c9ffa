// This file declares loops: the sums of slopes round the corners of lenslets, and what a vortex
// makes of them.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>

#include "core/lattice.h"

namespace curlew {

// The loops of a vortex are those of a square of cells, kLoopSide cells a side.
inline constexpr int kLoopReach = 3;
inline constexpr int kLoopSide = 2 * kLoopReach;
using VortexLoops = std::array<float, std::size_t{kLoopSide} * kLoopSide>;

/// Returns what a lenslet's edges add to the loops round its corners 00, 01, 10 and 11. Edge A, s_x
/// + s_y, runs round corner 10 in the positive sense, and edge B, s_y − s_x, round corner 00.
inline std::array<float, 4> along_corners(float x, float y) {
  const float a = x + y;
  const float b = y - x;
  return {b, -a, a, -b};
}

/// Calls use(corner, i, j) for the cells round a vortex that lie on the array. Here i and j are the
/// row and column in the square of cells.
template <typename Use>
void for_each_cell(const Lattice& lattice, float x, float y, Use use) {
  const int top = static_cast<int>(std::floor(y + 0.5F)) - kLoopReach + 1;  // in corners
  const int left = static_cast<int>(std::floor(x + 0.5F)) - kLoopReach + 1;
  for (int i = 0; i < kLoopSide; ++i) {
    for (int j = 0; j < kLoopSide; ++j) {
      if (top + i < 1 || top + i >= lattice.rows() || left + j < 1 || left + j >= lattice.cols())
        continue;
      use((top + i) * lattice.corner_cols() + left + j, i, j);
    }
  }
}

/// Returns the loops of a vortex in the cells round it. They are scaled to add up to 2π·charge on
/// each sublattice, so that they hold the share of the cells farther out.
VortexLoops vortex_loops(float x, float y, float charge, float softening) noexcept;

}  // namespace curlew
