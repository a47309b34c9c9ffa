// Says whether a pixel of a window holds light, or what is wrong with it.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "centroiding/centroid.h"
#include "centroiding/frame_level.h"
#include "centroiding/sharp_pixels.h"
#include "core/as_size.h"
#include "core/frame.h"

namespace curlew {

enum class PixelFault {
  kNone,
  kSingle,  ///< it is sharp or dead, and its neighbours tell what light it would have
  kWide,    ///< it belongs to a line or clump of such pixels, so that they do not
};

/// A pixel this many standard deviations above what light allows is none.
inline constexpr float kSharpSigmas = 4.5F;
inline constexpr float kClumpSigmas = 7.0F;

/// How far below the level a pixel is dead, in counts: 6 standard deviations of the noise. It is
/// infinite where nothing is known of the noise.
inline float dead_depth(const FrameLevels& levels) noexcept {
  constexpr float kOfThreshold = 1.5F;  // T is 4 σ
  constexpr float kSigmas = 6.0F;
  const float depth =
      std::max(kOfThreshold * levels.threshold, kSigmas * std::sqrt(levels.pixel_variance));
  return depth > 0.0F ? depth : INFINITY;
}

/// Looks at the pixels of one lenslet's window.
///
/// - A pixel is sharp where its light exceeds `sharpness` times the second brightest of its four
///   neighbours by 4.5 √(σ² + k·light), all above the frame's level.
/// - A pixel of a bright column exceeds its neighbours to the left and right by 1.75 times as much,
///   as side lobes of light do not. It lies in the last third of its window, another one in the
///   first, and a quarter of the window's height do. Rows are alike.
/// - A pixel is in a clump where it exceeds the second brightest of the four pixels that are two
///   away as a sharp one exceeds its neighbours, with SharpPixelPlan::clump_sharpness and 7 instead
///   of 4.5 standard deviations: noise must not take a lenslet out. A pixel that is sharp by itself
///   is in none.
/// - What the window's brightest pixel outshines forty times is neither: it pulls nothing.
/// - A pixel is dead where it lies dead_depth() below the level, and below the calibration's dark:
///   light lies on the level, too. That does harm only where one of its neighbours has light above
///   the threshold.
class PixelFaults {
 public:
  PixelFaults(const SharpPixelPlan& sharp, const CentroidPlan& plan, FrameView frame,
              const FrameLevels& levels, std::size_t lenslet,
              const CentroidPlan::Spot& window) noexcept
      : sharpness_(sharp.sharpness),
        clump_sharpness_(sharp.clump_sharpness),
        plan_(plan),
        frame_(frame),
        levels_(levels),
        level_(levels.level[lenslet]),
        window_(window) {}

  /// Returns what is wrong with the pixel at (x, y), which is in the window and not at the frame's
  /// rim. Reads no row of the frame beyond y + 1 and those of the window.
  PixelFault at(int x, int y) const noexcept;

  /// Returns whether the pixel, which is two pixels or more from the frame's rim, is in a clump.
  /// Reads no row beyond y + 2 and those of the window.
  bool is_in_clump(int x, int y) const noexcept;

 private:
  float light(int x, int y) const noexcept;
  bool exceeds(float here, float neighbour, float times, float sigmas) const noexcept;
  bool is_sharp(float here, float neighbour) const noexcept;
  bool is_line_sharp(float here, float neighbour) const noexcept;
  bool is_outshone(float here) const noexcept;
  bool is_dead(float here) const noexcept;
  PixelFault dead(int x, int y) const noexcept;
  bool is_in_bright_column(int x, int y) const noexcept;
  bool is_in_bright_row(int x, int y) const noexcept;

  float sharpness_;  ///< 0: nothing is sharp
  float clump_sharpness_;
  const CentroidPlan& plan_;
  FrameView frame_;
  const FrameLevels& levels_;
  float level_;  ///< counts
  const CentroidPlan::Spot& window_;
};

}  // namespace curlew
