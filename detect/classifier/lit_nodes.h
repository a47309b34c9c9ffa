// This file declares where there is enough light for a vortex to be seen.
#pragma once

#include "core/centroids.h"
#include "core/vortex.h"

namespace curlew {

/// Returns whether light shows what is at the node between lenslets (row, col) and (row + 1, col +
/// 1). Of its four lenslets at most one tells nothing, and no more than 3 of the 16 round it are
/// missing then: at the rim of what is lit there is no loop round a vortex, and lenslets that are
/// lit in part have spots of other shapes. A lenslet tells nothing where it is missing
/// (is_missing()). By a shadow, where 2 or more of the 16 are missing, it tells nothing either
/// where it is dark without most of those round it being lit. Elsewhere what is dark may be the
/// core of a vortex.
bool is_seen(const Centroids& centroids, float mean_flux_adu, int row, int col) noexcept;

/// Returns the same of the cell that the vortex lies in.
bool is_seen(const Centroids& centroids, float mean_flux_adu, const Vortex& vortex) noexcept;

}  // namespace curlew
