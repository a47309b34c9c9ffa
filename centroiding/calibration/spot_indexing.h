// Spot indexing: which column and row of the lenslet grid each spot belongs to.
#pragma once

#include <map>
#include <utility>
#include <vector>

#include "centroiding/calibration/spot_search.h"
#include "core/lenslet_grid.h"

namespace curlew {

/// (col, row), of any origin while the grid is sought.
using LensletIndex = std::pair<int, int>;

using IndexedSpots = std::map<LensletIndex, Spot>;

/// Numbers the candidates by walking from neighbour to neighbour, brightest first, so that a slow
/// distortion can add up to more than a pitch. (0, 0) is the spot among the best neighbours.
/// Of `grid` only P counts, in px. What the walk does not reach is left out; empty for none.
IndexedSpots index_spots(const std::vector<Spot>& candidates, const LensletGrid& grid);

}  // namespace curlew
