// The inner loops of SpotFeatures: windows' pixels onto the products of Hermite functions.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "core/frame.h"

namespace curlew {

inline constexpr int kProjectionOrders = 6;
inline constexpr int kProjectionLanes = 8;                 ///< of a row of the tables: orders, 1, 0
inline constexpr int kProjectionOnes = kProjectionOrders;  ///< the lane that is 1
/// Floats that are written past the last window's modes.
inline constexpr int kProjectionSlack = kProjectionLanes;

/// What windows of a frame have in common.
struct ProjectedFrame {
  const std::byte* pixels = nullptr;
  PixelType pixel_type = PixelType::kU16;
  std::ptrdiff_t cols = 0;
  std::ptrdiff_t size = 0;         ///< pixels
  const float* table = nullptr;    ///< [steps, kProjectionLanes] of the functions
  std::ptrdiff_t table_step = 0;   ///< floats from a pixel to the next
  float offset = 0;                ///< counts, where `offsets` is none
  const float* offsets = nullptr;  ///< [frame], with `gains`: signal = (count − offset)·gain
  const float* gains = nullptr;
  float e_per_count = 1;
  float row_sign = 1;  ///< of odd orders along y
};

struct ProjectedWindow {
  std::int32_t first = 0;  ///< index of the window's first pixel
  std::int32_t w = 0;
  std::int32_t h = 0;
  std::int32_t along_x = 0;  ///< where in the table the functions at the first column begin
  std::int32_t along_y = 0;  ///< likewise at the first row
  float read_noise = 0;      ///< of the whole window, electrons
};

/// Electrons of a window whose signals sum to `total`, kept off 0 by the read noise alone: the
/// shape of a spot without noise is known however dark.
inline float flux_of(const ProjectedFrame& frame, const ProjectedWindow& window,
                     float total) noexcept {
  return std::max(frame.e_per_count * total, 0.0F) + window.read_noise + 1e-6F;
}

/// For each of n windows, which[i] of `windows`: its modes Σ signal·h_m(x)·h_n(y) over its flux,
/// for m + n < kProjectionOrders, by n, then m, at modes + i·stride; fluxes[i]: its flux. A frame
/// has kProjectionLanes columns or more.
void project_windows(const ProjectedFrame& frame, const ProjectedWindow* windows,
                     const std::int32_t* which, int n, std::ptrdiff_t stride, float* modes,
                     float* fluxes) noexcept;

/// The same of one window, slower, to the last bit as the network was taught: the flux. Other sums
/// would make other weights of the same training.
float project_window(const ProjectedFrame& frame, const ProjectedWindow& window,
                     float* modes) noexcept;

/// values[i] = log(values[i]), n a multiple of kProjectionLanes, to 4 units in the last place.
void take_logarithms(int n, float* values) noexcept;

}  // namespace curlew
