// A turn of the whole spot pattern against the references, as where an instrument flexes.
#pragma once

#include "core/centroids.h"
#include "core/slope_field.h"

namespace curlew {

/// Takes the turn of the whole pattern out of the slopes and returns it, in rad per pitch². It is
/// half of the median circulation of the cells whose four lenslets are valid, which vortices hardly
/// change. A pattern that is turned by 1° gives every cell a circulation, of 2 rad and more for
/// common sensors, and no vortex does that. Where there are fewer than 40 such cells, or where the
/// median lies within four times its own error, the slopes stay as they are and the turn is 0.
///
/// Lenslets without light have no spot that could be turned: their slopes stay as they are. The
/// maps are [rows, cols] of lenslets, of the same size. Never allocates.
float subtract_turn(const Centroids& centroids, SlopeField& slopes) noexcept;

}  // namespace curlew
