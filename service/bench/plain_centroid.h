// Plain loops find centroids here, as a careful engineer would write them in C. The kernel of
// centroiding/centroid.h is held against them. The source file is compiled with -O3 -ffast-math, so
// it includes nothing whose inline functions the rest of the program shares.
#pragma once

#include <array>
#include <cstdint>

namespace curlew {

/// Each loop is compiled several times, once for each of these instruction sets.
enum class PlainBuild : std::uint8_t { kPortable, kAvx2, kAvx512 };
inline constexpr std::array<PlainBuild, 3> kPlainBuilds = {PlainBuild::kPortable, PlainBuild::kAvx2,
                                                           PlainBuild::kAvx512};

/// Returns "portable", "avx2" or "avx512".
const char* name_of(PlainBuild build) noexcept;

/// Says whether this processor can run it.
bool can_run(PlainBuild build) noexcept;

/// Says in which order the loops walk the pixels.
enum class PlainOrder : std::uint8_t {
  kWindows,  ///< one window after another; any list of windows allows that
  kRows,     ///< whole rows of the frame, into sums of columns; only windows in a grid allow that
};

/// A frame of rows × cols lenslets whose square windows tile it. pixels, gain and offset are
/// [rows·window_px, cols·window_px]. A pixel's signal is max(gain·count − offset, 0). The gain is
/// 1/flat, and 0 where the pixel is bad. The offset is gain·dark + threshold, in counts.
template <typename Pixel>
struct PlainFrame {
  int rows;
  int cols;
  int window_px;
  const Pixel* pixels;
  const float* gain;
  const float* offset;
};

/// The maps are [rows, cols] of lenslets. A window without signal gets the position of its first
/// pixel.
struct PlainCentroids {
  float* x_px;  ///< on the detector
  float* y_px;
  float* flux;        ///< counts
  float* column_sum;  ///< scratch that kRows needs, [2·cols·window_px]
};

/// Finds flux and centre of gravity in one pass over the pixels. Pixel is std::uint8_t or
/// std::uint16_t. can_run(build) must be true.
template <typename Pixel>
void find_plain_centroids(PlainBuild build, PlainOrder order, const PlainFrame<Pixel>& frame,
                          const PlainCentroids& centroids) noexcept;

/// Returns the sum of n pixels. It takes as long as only to read them.
template <typename Pixel>
std::uint64_t sum_pixels(PlainBuild build, const Pixel* pixels, std::int64_t n) noexcept;

}  // namespace curlew
