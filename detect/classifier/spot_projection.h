// This file declares the inner loops of SpotFeatures, which project windows' pixels onto products
// of Hermite functions.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "core/frame.h"

namespace curlew {

inline constexpr int kProjectionOrders = 6;
inline constexpr int kProjectionLanes = 8;                 ///< row of the table: orders, 1, 0
inline constexpr int kProjectionOnes = kProjectionOrders;  ///< the lane that is 1
/// So many floats may be written past the last window's modes.
inline constexpr int kProjectionSlack = kProjectionLanes;

/// Holds what all windows of a frame have in common.
struct ProjectedFrame {
  const std::byte* pixels = nullptr;
  PixelType pixel_type = PixelType::kU16;
  std::ptrdiff_t cols = 0;
  std::ptrdiff_t size = 0;         ///< number of pixels
  const float* table = nullptr;    ///< [steps, kProjectionLanes] Hermite functions
  std::ptrdiff_t table_step = 0;   ///< floats from one pixel to the next
  float offset = 0;                ///< in counts, used where `offsets` is null
  const float* offsets = nullptr;  ///< [frame], used with `gains`: signal = (count − offset)·gain
  const float* gains = nullptr;
  float e_per_count = 1;
  float row_sign = 1;  ///< sign of odd orders along y
};

struct ProjectedWindow {
  std::int32_t first = 0;  ///< index of the window's first pixel
  std::int32_t w = 0;
  std::int32_t h = 0;
  std::int32_t along_x = 0;  ///< index in the table of the functions at the first column
  std::int32_t along_y = 0;  ///< index in the table of the functions at the first row
  float read_noise = 0;      ///< read noise of the whole window, electrons
  float level = 0;  ///< of the frame above `offset`, counts; pixels of gain 0 do not have it
};

/// Returns the electrons of a window whose signals sum to `total`. Only the read noise keeps them
/// off 0, because the shape of a spot without noise is known however dark it is.
inline float flux_of(const ProjectedFrame& frame, const ProjectedWindow& window,
                     float total) noexcept {
  return std::max(frame.e_per_count * total, 0.0F) + window.read_noise + 1e-6F;
}

/// Projects n windows. It writes the modes Σ signal·h_m(x)·h_n(y) over the flux, for m + n <
/// kProjectionOrders, ordered by n and then by m, from modes + i·stride on, and the flux to
/// fluxes[i]. The frame must have at least kProjectionLanes columns.
void project_windows(const ProjectedFrame& frame, const ProjectedWindow* windows, int n,
                     std::ptrdiff_t stride, float* modes, float* fluxes) noexcept;

/// Projects one window more slowly, to the last bit as in the training, and returns its flux. Other
/// sums would make other weights of the same training.
float project_window(const ProjectedFrame& frame, const ProjectedWindow& window,
                     float* modes) noexcept;

/// Sets values[i] = log(values[i]), to 4 units in the last place; n must be a multiple of
/// kProjectionLanes.
void take_logarithms(int n, float* values) noexcept;

}  // namespace curlew
