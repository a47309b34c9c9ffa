// Pixels that are no light through the optics: cosmic rays and hot pixels, which are too sharp, and
// pixels and lines that became dead or bright after the calibration.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "centroiding/centroid.h"
#include "centroiding/frame_level.h"
#include "centroiding/sensor.h"
#include "core/fixed_list.h"
#include "core/frame.h"
#include "core/image.h"

namespace curlew {

/// Const after construction, shared by threads.
struct SharpPixelPlan {
  SharpPixelPlan(const Sensor& sensor, const FrameFormat& format);

  LensletGrid grid;
  /// A pixel may be this many times as bright as the second brightest of its four neighbours, above
  /// the level; 1.4 times what the reference spots show, or would show in the middle of a pixel:
  /// all of them may lie between pixels, where a spot is hardly sharp. 0: nothing is looked for,
  /// because the spots are so sharp themselves, or nothing is known of them.
  float sharpness = 0;
  /// A pixel of a clump of hot pixels may be this many times as bright as the second brightest of
  /// the four pixels that are two away: three times what the narrowest spot would show in the
  /// middle of a pixel. 0: nothing is looked for.
  float clump_sharpness = 0;
  float dark = 0;      ///< the dark that 99 % of the pixels stay below, counts
  float low_dark = 0;  ///< the dark that 99 % of the pixels exceed, counts
};

/// One lenslet's pixel that is sharp or dead, and for which its neighbours can stand in.
struct SharpPixel {
  std::int32_t x = 0;  ///< in the frame
  std::int32_t y = 0;
  std::int32_t next = -1;  ///< the lenslet's next one in the list, or −1
};

/// Of one frame; made once and filled anew.
struct SharpPixels {
  SharpPixels(int rows, int cols);

  FixedList<SharpPixel> pixels;
  // Buffers of find_sharp_pixels().
  FixedList<SharpPixel> candidates;
  FixedList<SharpPixel> clump_candidates;
  std::vector<FixedList<SharpPixel>> parts;  ///< candidates of one piece of a team's work each
  Image<std::int32_t> first;  ///< [rows, cols] the lenslet's first in `pixels`, or −1
  /// [rows, cols] 1 where a line or clump of bright or dead pixels is in a lenslet's window. Such a
  /// lenslet is measured as kBadPixels.
  Image<std::uint8_t> broken;
  bool any_broken = false;

  // How far a frame that is still arriving has been looked at.
  int pixel_rows = 0;        ///< rows of the frame
  int clump_rows = 0;        ///< the same, for clumps
  std::size_t assigned = 0;  ///< candidates
  std::size_t clumps_assigned = 0;
};

/// Returns the count that stands in for a sharp pixel's own: the mean of the middle two of its four
/// neighbours. `pixels` is the frame, `cols` wide, and (x, y) is not at its rim.
template <typename Pixel>
float count_instead(const Pixel* pixels, int cols, const SharpPixel& sharp) noexcept {
  const Pixel* p = pixels + static_cast<std::ptrdiff_t>(sharp.y) * cols + sharp.x;
  const auto a = static_cast<float>(p[-1]), b = static_cast<float>(p[1]);
  const auto c = static_cast<float>(p[-cols]), e = static_cast<float>(p[cols]);
  const float low = std::min(std::min(a, b), std::min(c, e));
  const float high = std::max(std::max(a, b), std::max(c, e));
  return 0.5F * ((a + b) + (c + e) - low - high);
}

/// Finds the pixels of one frame's windows, which are [rows, cols] of lenslets, that are no light;
/// PixelFaults says which these are. Never allocates. Where there are more than the lists hold, the
/// lenslets whose pixels do not fit are `broken`.
void find_sharp_pixels(const SharpPixelPlan& plan, const CentroidPlan& centroid,
                       const Image<CentroidPlan::Spot>& windows, FrameView frame,
                       const FrameLevels& levels, SharpPixels& sharp,
                       Team* team = nullptr) noexcept;

/// Begins a frame that is still arriving.
void begin_sharp_pixels(SharpPixels& sharp) noexcept;

/// Looks at the frame's first `ready` rows, as far as levels.rows allows, and returns how many rows
/// have been looked at: no sharp pixel is missing in these. levels.bound, threshold and
/// pixel_variance must be what they are for the whole frame.
int find_sharp_pixels_rows(const SharpPixelPlan& plan, const CentroidPlan& centroid,
                           const Image<CentroidPlan::Spot>& windows, FrameView frame, int ready,
                           const FrameLevels& levels, SharpPixels& sharp,
                           Team* team = nullptr) noexcept;

/// Says again which lenslets' sharp pixels they are, of a frame that find_sharp_pixels() has looked
/// at, after windows were moved.
void assign_sharp_pixels(const SharpPixelPlan& plan, const CentroidPlan& centroid,
                         const Image<CentroidPlan::Spot>& windows, FrameView frame,
                         const FrameLevels& levels, SharpPixels& sharp) noexcept;

}  // namespace curlew
