// find_lenslet_grid() finds the lenslet grid of a reference frame, with no hint but the frame.
#pragma once

#include <cstdint>

#include "core/image.h"
#include "core/lenslet_grid.h"

namespace curlew {

/// This is what a reference frame shows. Lenslet maps are [grid.rows, grid.cols]; (0, 0) is a
/// corner of the smallest box that holds every lit lenslet.
struct FoundGrid {
  LensletGrid grid;         ///< least-squares fit to the spots, a general 2×2 matrix
  Image<std::uint8_t> lit;  ///< 1 where a lenslet has a spot
  Image<float> spot_x_px;   ///< spots, known to some tenths of a pixel; NaN where not lit
  Image<float> spot_y_px;
  int n_lit = 0;
  double residual_px = 0.0;  ///< rms distance of the spots from the grid, without those at the rim
  double anisotropy = 0.0;   ///< |P| along its longest over its shortest direction, less 1
  double background_adu = 0.0;  ///< median midway between spots
  double noise_adu = 0.0;       ///< standard deviation of one pixel there, from differences
  // These maps are [rows, cols] of the frame.
  Image<std::uint8_t> hot;     ///< 1 where a pixel is too sharp to be a spot's
  Image<std::uint8_t> border;  ///< 1 where the rim holds no picture (find_borders()), or empty
};

/// Finds a square grid of spots. The pitch may be 4 px to a quarter of the frame's shorter side,
/// the rotation anything in (−45°, 45°), and the pupil any of at least 2×2 lenslets.
/// `reference_adu` is [rows, cols], and NaN counts as bad. `bad_pixel` has the same shape or is
/// empty. `mirrored` says that rows run up the detector (det P < 0), which cannot be seen in the
/// spots. Throws Failure where there is no light, no grid, or a grid that is hexagonal or not
/// square.
FoundGrid find_lenslet_grid(const Image<float>& reference_adu, const Image<std::uint8_t>& bad_pixel,
                            bool mirrored);

/// This is the level and noise of an image midway between four spots, where there is least light.
struct Level {
  double median_adu = 0.0;
  double noise_adu = 0.0;  ///< noise of one pixel, from differences of neighbours
};

/// Measures the level between the spots lenslet by lenslet and returns it for every pixel: the
/// median of the 3×3 nearest corners of lenslets, interpolated between the corners. `image_adu`
/// must not hold NaN.
Image<float> map_between_spots(const Image<float>& image_adu, const LensletGrid& grid);

/// Measures the level and noise between the spots; one frame of a recording tells its read noise
/// this way. The image must not hold NaN, because pixels are not tested for it. A grid so fine that
/// no pixel lies within 0.15 pitches of the middle gives zeros.
Level measure_between_spots(const Image<float>& image_adu, const LensletGrid& grid);

}  // namespace curlew
