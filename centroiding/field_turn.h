// A turn of the whole spot pattern against the references, as where an instrument flexes.
#pragma once

#include "centroiding/cell_sample.h"
#include "core/centroids.h"
#include "core/slope_field.h"

namespace curlew {

/// Takes the turn of the whole pattern out of the slopes, and its circulation out of their sample,
/// and returns it, in rad per pitch². It is half of the sample's median circulation, which vortices
/// hardly change. A pattern that is turned by 1° gives every cell a circulation, of 2 rad and more
/// for common sensors, and no vortex does that. Where the sample is too small, or where the median
/// lies within four times its own error, the slopes stay as they are and the turn is 0.
///
/// Lenslets without light have no spot that could be turned: their slopes stay as they are. The
/// maps are [rows, cols] of lenslets, of the same size. Never allocates.
float subtract_turn(const Centroids& centroids, CellSample& sample, SlopeField& slopes) noexcept;

}  // namespace curlew
