// The inner loops of SpotFeatures: a window's pixels onto the products of Hermite functions.
#pragma once

#include <cstddef>

#include "core/frame.h"

namespace curlew {

inline constexpr int kProjectionOrders = 6;
inline constexpr int kProjectionLanes = 8;                 ///< of a row of the tables: orders, 1, 0
inline constexpr int kProjectionOnes = kProjectionOrders;  ///< the lane that is 1

/// One window; pixel (row, col) is pixels[row·frame_cols + col] of the frame's type.
struct ProjectedWindow {
  const std::byte* pixels = nullptr;  ///< the frame's
  PixelType pixel_type = PixelType::kU16;
  std::ptrdiff_t first = 0;  ///< index of the window's first pixel
  std::ptrdiff_t frame_cols = 0;
  int w = 0;
  int h = 0;
  const float* along_x =
      nullptr;  ///< functions at the first column, then every `table_step` floats
  const float* along_y = nullptr;  ///< likewise down the rows
  std::ptrdiff_t table_step = 0;
  float offset = 0;                ///< counts, where `offsets` is none
  const float* offsets = nullptr;  ///< [frame], with `gains`: signal = (count − offset)·gain
  const float* gains = nullptr;
};

/// Fills sums[n·kProjectionLanes + m] = Σ signal·h_m(x)·h_n(y) and returns Σ signal.
float project_window(const ProjectedWindow& window, float* sums) noexcept;

}  // namespace curlew
