// Slopes of phases that are given as functions.
#pragma once

#include <cstdint>
#include <functional>

#include "core/image.h"
#include "core/slope_field.h"

namespace curlew {

/// A phase in rad at a place in lenslet units.
using Phase = std::function<double(double, double)>;

/// Returns the mean gradients over the lenslets of a phase, by its differences across the squares.
inline SlopeField slopes_of(const Phase& phase, const Image<std::uint8_t>& valid) {
  constexpr int kAlongSide = 400;
  SlopeField slopes(valid.rows(), valid.cols());
  slopes.valid = valid;
  for (int row = 0; row < valid.rows(); ++row)
    for (int col = 0; col < valid.cols(); ++col) {
      if (valid(row, col) == 0) continue;
      double x = 0.0;
      double y = 0.0;
      for (int i = 0; i < kAlongSide; ++i) {
        const double along = (i + 0.5) / kAlongSide - 0.5;
        x += phase(col + 0.5, row + along) - phase(col - 0.5, row + along);
        y += phase(col + along, row + 0.5) - phase(col + along, row - 0.5);
      }
      slopes.x(row, col) = static_cast<float>(x / kAlongSide);
      slopes.y(row, col) = static_cast<float>(y / kAlongSide);
    }
  return slopes;
}

}  // namespace curlew
