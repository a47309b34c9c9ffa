// This file makes slope fields of known vortices, for the tests of detect/.
#pragma once

#include <cstddef>

#include "core/slope_field.h"
#include "detect/vortex_kernel.h"

namespace curlew::testing {

/// Returns a field whose slopes are 0 and whose variances are `variance`. Every lenslet is valid.
inline SlopeField flat_field(int rows, int cols, float variance = 0.0F) {
  SlopeField slopes(rows, cols);
  slopes.variance_x.fill(variance);
  slopes.variance_y.fill(variance);
  slopes.valid.fill(1);
  slopes.n_valid = rows * cols;
  return slopes;
}

/// Adds the uniform-average slopes of a vortex at (x, y) in lenslet units.
inline void add_vortex(SlopeField& slopes, double x, double y, Morphology morphology = {}) {
  const VortexKernel kernel(morphology);
  for (int r = 0; r < slopes.rows(); ++r) {
    for (int c = 0; c < slopes.cols(); ++c) {
      const auto s = kernel.lenslet_slopes(c - x, r - y);
      slopes.x(r, c) += static_cast<float>(s[0]);
      slopes.y(r, c) += static_cast<float>(s[1]);
    }
  }
}

/// Removes a lenslet as the slope stage does: all its values become 0.
inline void remove_lenslet(SlopeField& slopes, int row, int col) {
  slopes.n_valid -= slopes.valid(row, col) != 0 ? 1 : 0;
  slopes.valid(row, col) = 0;
  for (Image<float>* map :
       {&slopes.x, &slopes.y, &slopes.variance_x, &slopes.variance_y, &slopes.covariance_xy}) {
    (*map)(row, col) = 0.0F;
  }
}

}  // namespace curlew::testing
