// Some lenslets' windows, side by side: one for each lane of a vector.
#pragma once

#include <array>
#include <cstddef>

#include "centroiding/centroid.h"
#include "centroiding/centroid_methods.h"

namespace curlew {

inline constexpr std::size_t kMaxLanes = 16;
inline constexpr std::size_t kMaxSide = kMaxMethodWindow;
// What a bad pixel holds, and one beyond the lenslet's window: nothing, or, for the fit, which
// would take that for darkness, what no pixel can.
inline constexpr float kNothing = 0.0F;
inline constexpr float kBad = -1e30F;

/// A value a lenslet.
using LaneValues = std::array<float, kMaxLanes>;
/// As many vectors as the widest windows have pixels.
using WindowBuffer = std::array<float, kMaxSide * kMaxSide * kMaxLanes>;

/// Some lenslets and their windows.
struct WindowGroup {
  std::size_t n = 0;  ///< lenslets; the lanes after them repeat the first
  std::array<std::size_t, kMaxLanes> lenslet{};
  std::size_t w = 0;  ///< of the widest window
  std::size_t h = 0;
  // Of each: where its window's centre lies from its first pixel, the window's size, the reference
  // from the centre, the threshold's centroid from the centre (the reference where it has none).
  alignas(64) LaneValues half_x{}, half_y{}, width{}, height{}, reference_x{},
      reference_y{}, start_x{}, start_y{};
};

/// What a method says of a group's lenslets. Positions are relative to the windows' centres.
struct GroupPositions {
  alignas(64) LaneValues x, y, variance_x, variance_y, covariance;
  alignas(64) LaneValues signal, signal_variance;  ///< what min_snr is asked of
  alignas(64) LaneValues flux;                     ///< of a Gaussian spot of this signal, counts
};

/// Fills in all but n and the first n lenslets, which are given.
void describe_windows(const CentroidPlan& plan, const Centroids& found, std::size_t lanes,
                      WindowGroup& group) noexcept;

/// light: [h, w, lanes], counts above the dark.
void load_windows(const CentroidPlan& plan, FrameView frame, const WindowGroup& group,
                  std::size_t lanes, float* light) noexcept;

/// Puts one lenslet's position in the place of the threshold's.
void adopt_position(const CentroidPlan& plan, const GroupPositions& found, std::size_t lane,
                    std::size_t k, Centroids& out) noexcept;

}  // namespace curlew
