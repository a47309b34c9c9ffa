// This file declares where there is enough light for a vortex to be seen.
#pragma once

#include <cstdint>

#include "core/centroids.h"
#include "core/image.h"
#include "core/vortex.h"

namespace curlew {

/// Says of one frame where light shows what is there.
class LitNodes {
 public:
  LitNodes(int rows, int cols);  ///< in lenslets

  /// Looks at a frame. `centroids` must live as long as is_seen() is called.
  void look_at(const Centroids& centroids, float mean_flux_adu) noexcept;

  /// Returns whether light shows what is at the node whose upper left lenslet this is. Of its four
  /// lenslets at most one tells nothing, and no more than 3 of the 16 round it are missing then: at
  /// the rim of what is lit there is no loop round a vortex, and lenslets that are lit in part have
  /// spots of other shapes. A lenslet tells nothing where it is missing (is_missing()). By a
  /// shadow, where 2 or more of the 16 are missing, it tells nothing either where it is dark
  /// without most of those round it being lit. Elsewhere what is dark may be the core of a vortex.
  bool is_seen(int row, int col) const noexcept;

  /// Returns the same of the cell that the vortex lies in.
  bool is_seen(const Vortex& vortex) const noexcept;

 private:
  const Centroids* centroids_ = nullptr;
  float dark_adu_ = 0.0F;
  Image<std::uint8_t> gone_;     ///< [rows + 2, cols + 2] 1 where a lenslet is missing; a rim of 0
  Image<std::uint8_t> in_row_;   ///< [rows + 2, cols − 1] the sum of four along a row
  Image<std::uint8_t> missing_;  ///< [rows − 1, cols − 1] of the 16 lenslets round a node
};

}  // namespace curlew
