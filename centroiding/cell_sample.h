// Cells whose circulation tells what is common to all of a frame's slopes.
#pragma once

#include <array>
#include <cstddef>
#include <span>

#include "core/centroids.h"
#include "core/slope_field.h"

namespace curlew {

/// The circulation of cells that are spread over the array and whose four lenslets are valid.
/// Vortices and spots in the dark hardly take part in it.
struct CellSample {
  static constexpr std::size_t kMost = 400;
  static constexpr std::size_t kFewest = 40;  ///< Fewer cells tell nothing.

  std::array<float, kMost> circulation_rad{};
  std::array<std::size_t, kMost> lenslet{};  ///< index of the cell's lenslet (r, c)
  std::size_t n = 0;

  std::span<float> circulations() { return {circulation_rad.data(), n}; }
  std::span<const float> circulations() const { return {circulation_rad.data(), n}; }
};

/// Fills the sample anew. `centroids` and `slopes` are [rows, cols] of the same lenslets. Never
/// allocates.
void sample_cells(const Centroids& centroids, const SlopeField& slopes,
                  CellSample& sample) noexcept;

/// Returns by how many standard deviations `count` of n values lies from half of them, where each
/// value is one of these with probability ½.
float sigmas_from_half(std::size_t count, std::size_t n) noexcept;

}  // namespace curlew
