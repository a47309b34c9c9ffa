// This file declares the fit of the lenslet grid to numbered spots.
#pragma once

#include "centroiding/calibration/spot_indexing.h"
#include "core/lenslet_grid.h"

namespace curlew {

/// Fits (x, y) = origin + P·(col, row) by least squares, in px, where P is a general 2×2 matrix.
/// Spots that the rim cuts are left out. So are spots beyond three times the median distance (and
/// beyond .05 pitches), so that a smeared spot cannot tilt the grid. Returns false where the
/// remaining spots do not span a plane. The grid's rows and cols stay as they are.
bool fit_grid(LensletGrid& grid, const IndexedSpots& spots);

/// Returns the rms distance in px of the spots from their grid places. Spots that the rim cuts are
/// left out unless all are cut. It is 0 where there are no spots.
double rms_distance_px(const LensletGrid& grid, const IndexedSpots& spots);

/// Returns the ratio of the singular values of P, less 1. It is 0 for a grid that is neither
/// stretched nor sheared.
double anisotropy_of(const LensletGrid& grid);

}  // namespace curlew
