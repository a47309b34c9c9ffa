#include "reconstruct/vortex_loops.h"

#include <cstdint>

#include "core/as_size.h"

namespace curlew {
namespace {

constexpr float kTwoPi = 6.28318530718F;

}  // namespace

VortexLoops vortex_loops(float x, float y, float charge, float softening) noexcept {
  // The lenslets of the square begin here, relative to the vortex.
  const float top = std::floor(y + 0.5F) - static_cast<float>(kLoopReach) - y;
  const float left = std::floor(x + 0.5F) - static_cast<float>(kLoopReach) - x;
  VortexLoops loops{};
  for (int i = 0; i <= kLoopSide; ++i) {
    for (int j = 0; j <= kLoopSide; ++j) {
      const float dx = left + static_cast<float>(j);
      const float dy = top + static_cast<float>(i);
      const float inverse = charge / (dx * dx + dy * dy + softening);
      const auto along = along_corners(-dy * inverse, dx * inverse);
      const auto add = [&](int row, int col, float value) {
        if (row >= 0 && row < kLoopSide && col >= 0 && col < kLoopSide)
          loops[as_size(row * kLoopSide + col)] += value;
      };
      add(i - 1, j - 1, along[0]);
      add(i - 1, j, along[1]);
      add(i, j - 1, along[2]);
      add(i, j, along[3]);
    }
  }
  float sum[2] = {0.0F, 0.0F};
  for (int i = 0; i < kLoopSide; ++i)
    for (int j = 0; j < kLoopSide; ++j) sum[(i + j) % 2] += loops[as_size(i * kLoopSide + j)];
  for (int i = 0; i < kLoopSide; ++i)
    for (int j = 0; j < kLoopSide; ++j)
      loops[as_size(i * kLoopSide + j)] *= charge * kTwoPi / sum[(i + j) % 2];
  return loops;
}

}  // namespace curlew
