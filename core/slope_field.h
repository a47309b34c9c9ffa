// A SlopeField is the measured phase gradient, one vector per lenslet.
#pragma once

#include <cstdint>

#include "core/image.h"

namespace curlew {

/// Holds the slopes s = w·G along the lenslet axes (col, row), in radians per pitch, where w is the
/// pitch and G the mean phase gradient over a lenslet. All maps are [rows, cols]. Where valid is 0
/// the other maps hold 0 and take no part in anything.
struct SlopeField {
  SlopeField(int rows, int cols)
      : x(rows, cols),
        y(rows, cols),
        variance_x(rows, cols),
        variance_y(rows, cols),
        covariance_xy(rows, cols),
        valid(rows, cols) {}

  int rows() const { return x.rows(); }
  int cols() const { return x.cols(); }

  Image<float> x;
  Image<float> y;
  Image<float> variance_x;  ///< rad² per pitch²
  Image<float> variance_y;
  Image<float> covariance_xy;
  Image<std::uint8_t> valid;
  int n_valid = 0;
};

}  // namespace curlew
