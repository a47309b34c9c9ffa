// Grid fit: the lenslet grid nearest to numbered spots.
#pragma once

#include "centroiding/calibration/spot_indexing.h"
#include "core/lenslet_grid.h"

namespace curlew {

/// Least squares of (x, y) = origin + P·(col, row), in px; P is a general 2×2 matrix. Spots cut
/// by the rim are left out, and what is beyond three times the median distance: a smeared spot
/// shall not tilt the grid. False where the rest does not span a plane; rows and cols of the grid
/// stay as they are.
bool fit_grid(LensletGrid& grid, const IndexedSpots& spots);

/// The rms distance in px of the spots from their grid places. Spots cut by the rim are left out
/// unless all are; 0 for no spots.
double rms_distance_px(const LensletGrid& grid, const IndexedSpots& spots);

/// Ratio of the singular values of P, less 1: 0 for a grid that is neither stretched nor sheared.
double anisotropy_of(const LensletGrid& grid);

}  // namespace curlew
