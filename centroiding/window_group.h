// A WindowGroup holds the windows of several lenslets side by side: each lane of a vector is one
// lenslet.
#pragma once

#include <array>
#include <cstddef>

#include "centroiding/centroid.h"
#include "centroiding/centroid_methods.h"

namespace curlew {

inline constexpr std::size_t kMaxLanes = 16;
inline constexpr std::size_t kMaxSide = kMaxMethodWindow;
// One of these values stands for a bad pixel and for one outside the lenslet's window. Most methods
// take kNothing, which adds no light. The maximum-likelihood fit would take that for darkness, and
// takes kBad, which no real pixel can hold.
inline constexpr float kNothing = 0.0F;
inline constexpr float kBad = -1e30F;

/// These are values of which each lane has one.
using LaneValues = std::array<float, kMaxLanes>;
/// The buffer has one vector for each pixel of the widest window.
using WindowBuffer = std::array<float, kMaxSide * kMaxSide * kMaxLanes>;

/// These are the lenslets of a group and their windows.
struct WindowGroup {
  std::size_t n = 0;  ///< number of lenslets; the lanes after them repeat the first
  std::array<std::size_t, kMaxLanes> lenslet{};
  std::size_t w = 0;  ///< width of the widest window, px; h is the largest height
  std::size_t h = 0;
  // Each lane has the distance of its window's centre from the first pixel, the window's size, the
  // reference and the start. The reference and the start are relative to the centre. The start is
  // the threshold's centroid, or the reference where the lenslet is not valid.
  alignas(64) LaneValues half_x{}, half_y{}, width{}, height{}, reference_x{},
      reference_y{}, start_x{}, start_y{};
};

/// These are the results of a method for a group's lenslets. Positions are relative to the windows'
/// centres.
struct GroupPositions {
  alignas(64) LaneValues x, y, variance_x, variance_y, covariance;
  alignas(64) LaneValues signal, signal_variance;  ///< their ratio is compared with min_snr
  alignas(64) LaneValues flux;  ///< flux of a Gaussian spot of this signal, counts
};

/// Fills in the group from its n and its first n lenslets, which the caller has set. `found` holds
/// what the threshold's kernel measured.
void describe_windows(const CentroidPlan& plan, const FrameConditions& conditions,
                      const Centroids& found, std::size_t lanes, WindowGroup& group) noexcept;

/// Loads the pixels of the group's windows. `light` is [h, w, lanes], in counts above the frame's
/// level, or above the dark where that is not known. Sharp pixels hold what count_instead() says.
void load_windows(const CentroidPlan& plan, FrameView frame, const WindowGroup& group,
                  std::size_t lanes, const FrameConditions& conditions, float* light) noexcept;

/// Replaces the position that the threshold's kernel found for lenslet k by the one in `lane` of
/// `found`.
void adopt_position(const CentroidPlan& plan, const FrameConditions& conditions,
                    const GroupPositions& found, std::size_t lane, std::size_t k,
                    Centroids& out) noexcept;

}  // namespace curlew
