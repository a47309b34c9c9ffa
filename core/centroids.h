// Centroids: one spot's moments per lenslet.
#pragma once

#include <cstdint>

#include "core/image.h"

namespace curlew {

/// Whether a lenslet's spot counts in this frame, and if not, why.
enum class LensletState : std::uint8_t {
  kValid = 0,
  kUnlit,      ///< outside the pupil: not part of the plan
  kFaint,      ///< too little light above the threshold
  kSaturated,  ///< a pixel in the window is saturated
  kAtEdge,     ///< the spot has left, or nearly left, its window
  kBadPixels,  ///< too much of the window is bad
};

/// All maps are [rows, cols] of lenslets. Where state is kFaint or kAtEdge the other values are as
/// measured, for who can do with weak spots, or 0 where no light exceeds the threshold. Where it is
/// anything else but kValid they are 0 and mean nothing (flux keeps what was measured).
struct Centroids {
  Centroids(int rows, int cols)
      : x_px(rows, cols),
        y_px(rows, cols),
        flux_adu(rows, cols),
        xx_px2(rows, cols),
        yy_px2(rows, cols),
        xy_px2(rows, cols),
        variance_x_px2(rows, cols),
        variance_y_px2(rows, cols),
        covariance_xy_px2(rows, cols),
        state(rows, cols, LensletState::kUnlit) {}

  Image<float> x_px;  ///< spot position on the detector
  Image<float> y_px;
  Image<float> flux_adu;  ///< above threshold
  Image<float> xx_px2;    ///< central second moments of the spot
  Image<float> yy_px2;
  Image<float> xy_px2;
  Image<float> variance_x_px2;  ///< noise variance of x_px from photon and read noise
  Image<float> variance_y_px2;
  Image<float> covariance_xy_px2;
  Image<LensletState> state;
  int n_valid = 0;
  int n_saturated = 0;
};

}  // namespace curlew
