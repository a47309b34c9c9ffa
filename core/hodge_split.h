// A HodgeSplit is a slope field taken apart into its curl-free and its solenoidal part.
#pragma once

#include <cstdint>

#include "core/fixed_list.h"
#include "core/image.h"

namespace curlew {

/// Holds the circulation round one hole of the pupil, which the sensor file has or faded lenslets
/// made.
struct HoleCirculation {
  float x = 0;  ///< centre of the hole, lenslet units
  float y = 0;
  /// Circulation in rad, about 2π for one charge that hides in the hole. It is ½ (even loops + odd
  /// loops), or the one loop there is if one_sublattice is true.
  float circulation = 0;
  bool one_sublattice = false;
};

/// Slopes, in rad per pitch, and phase are [rows, cols] of lenslets and 0 where the frame's slope
/// is not valid. The potential is [rows-1, cols-1], one value per cell.
struct HodgeSplit {
  static constexpr std::int32_t kNoIsland = -1;
  static constexpr std::int32_t kLargeIsland = 4;

  HodgeSplit(int rows, int cols)
      : phase(rows, cols),
        curl_free_x(rows, cols),
        curl_free_y(rows, cols),
        solenoidal_x(rows, cols),
        solenoidal_y(rows, cols),
        potential(rows - 1, cols - 1),
        holes(static_cast<std::size_t>(rows) * static_cast<std::size_t>(cols)),
        island(rows, cols, kNoIsland) {}

  Image<float> phase;  ///< rad at lenslet centres, mean zero over each connected part
  Image<float> curl_free_x;
  Image<float> curl_free_y;
  Image<float> solenoidal_x;
  Image<float> solenoidal_y;
  /// This is ψ: the solenoidal slopes (x, y) are (−∂ψ/∂y, ∂ψ/∂x)/weight in the lattice's
  /// differences. ψ is 0 outside the pupil, and a positive vortex is a minimum of it.
  Image<float> potential;
  FixedList<HoleCirculation> holes;
  /// The connected part of each lenslet, whose phase has a constant of its own: 0 is the largest
  /// part, and so on by size. kNoIsland where the slope is not valid.
  Image<std::int32_t> island;
  int n_islands = 0;
  int n_large_islands = 0;  ///< those of kLargeIsland lenslets or more
  int iterations = 0;       ///< steps of correction or refinement; 0 if solved directly
  bool converged = true;    ///< false if the iteration limit came before the tolerance
};

}  // namespace curlew
