// Centroids holds the moments of one spot per lenslet.
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/image.h"

namespace curlew {

/// Says whether a lenslet's spot counts in this frame, and if not, why.
enum class LensletState : std::uint8_t {
  kValid = 0,
  kUnlit,      ///< the lenslet lies outside the pupil and is not part of the plan
  kFaint,      ///< too little light above the threshold
  kSaturated,  ///< a pixel in the window is saturated
  kAtEdge,     ///< the spot has left, or nearly left, its window
  kBadPixels,  ///< too much of the window is bad
  /// what is in the window is not the lenslet's spot, or the spot has left the frame
  kLost,
};

inline constexpr std::size_t kLensletStates = 7;  ///< the number of values of LensletState

/// All maps are [rows, cols] of lenslets. A kValid spot has all values. A kFaint or kAtEdge spot
/// has them too, for those stages that can use weak spots; they are 0 if no light exceeds the
/// threshold. A kLost lenslet keeps what was in its window, which means nothing. In every other
/// state the values are 0 and mean nothing, but flux_adu keeps what was measured.
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
        low_x_px(rows, cols),
        low_y_px(rows, cols),
        moved_x_px(rows, cols),
        moved_y_px(rows, cols),
        state(rows, cols, LensletState::kUnlit) {}

  Image<float> x_px;  ///< position of the spot on the detector
  Image<float> y_px;
  Image<float> flux_adu;  ///< light above the threshold
  Image<float> xx_px2;    ///< central second moments of the spot
  Image<float> yy_px2;
  Image<float> xy_px2;
  Image<float> variance_x_px2;  ///< noise variance of x_px from photon and read noise
  Image<float> variance_y_px2;
  Image<float> covariance_xy_px2;
  /// The low orders of the spots' displacements where the windows follow them, and the whole pixels
  /// by which each window has been moved; 0 where windows stay.
  Image<float> low_x_px;
  Image<float> low_y_px;
  Image<float> moved_x_px;
  Image<float> moved_y_px;
  Image<LensletState> state;
  int n_valid = 0;
  int n_saturated = 0;
  int n_lost = 0;  ///< lenslets that are kLost, where windows follow the spots
};

}  // namespace curlew
