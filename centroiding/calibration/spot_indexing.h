// This file declares spot indexing, which finds the column and row of the lenslet grid for each
// spot.
#pragma once

#include <map>
#include <utility>
#include <vector>

#include "centroiding/calibration/spot_search.h"
#include "core/lenslet_grid.h"

namespace curlew {

/// This is (col, row). Its origin is arbitrary while the grid is sought.
using LensletIndex = std::pair<int, int>;

using IndexedSpots = std::map<LensletIndex, Spot>;

/// Numbers the candidates by walking from neighbour to neighbour, the brightest first, so that a
/// slow distortion may add up to more than a pitch. (0, 0) is the spot with the best neighbours.
/// Only P of `grid` is used, in px. Candidates that the walk does not reach are left out. Without
/// candidates the result is empty.
IndexedSpots index_spots(const std::vector<Spot>& candidates, const LensletGrid& grid);

}  // namespace curlew
