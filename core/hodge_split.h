// HodgeSplit: a slope field taken apart into its curl-free and its solenoidal part.
#pragma once

#include "core/fixed_list.h"
#include "core/image.h"

namespace curlew {

/// What circulates round one hole of the pupil (static, or made by lenslets that faded).
struct HoleCirculation {
  float x = 0;  ///< its centre, lenslet units
  float y = 0;
  /// rad; about 2π for one charge hiding in it. ½ (even loops + odd loops), or the loop itself
  /// where one_sublattice.
  float circulation = 0;
  bool one_sublattice = false;
};

/// Slopes and phase are [rows, cols] of lenslets and 0 where the frame's slope is not valid;
/// the potential is [rows-1, cols-1], one value a cell.
struct HodgeSplit {
  HodgeSplit(int rows, int cols)
      : phase(rows, cols),
        curl_free_x(rows, cols),
        curl_free_y(rows, cols),
        solenoidal_x(rows, cols),
        solenoidal_y(rows, cols),
        potential(rows - 1, cols - 1),
        holes(static_cast<std::size_t>(rows) * static_cast<std::size_t>(cols)) {}

  Image<float> phase;  ///< rad at lenslet centres, mean zero over each connected part
  Image<float> curl_free_x;
  Image<float> curl_free_y;
  Image<float> solenoidal_x;
  Image<float> solenoidal_y;
  /// ψ: solenoidal (x, y) = (−∂ψ/∂y, ∂ψ/∂x)/weight in the lattice's differences, 0 outside the
  /// pupil. A positive vortex is a minimum of ψ.
  Image<float> potential;
  FixedList<HoleCirculation> holes;
  int iterations = 0;     ///< of conjugate gradients; 0 when solved directly
  bool converged = true;  ///< false: the iteration limit came before the tolerance
};

}  // namespace curlew
