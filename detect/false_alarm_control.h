// This file declares the control of false alarms: it marks the cells that stand out of the slopes'
// noise, for any detector that ranks them.
#pragma once

#include <cstdint>

#include "core/image.h"
#include "core/vortex.h"

namespace curlew {

/// Fills `marks`, which is of the map's size, with the sign of D where the cell is valid and |D|
/// exceeds threshold_sigmas·σ_D, and with 0 elsewhere. The threshold may be threshold_sigmas() of a
/// rate (false_alarms.h), or that of CirculationPlan for the cells valid in the frame. A detector
/// that reports a vortex only at a cell marked with its sign, and at most one of several side by
/// side, then makes at most that many false alarms a frame in slope noise.
void mark_significant(const CirculationMap& map, float threshold_sigmas,
                      Image<std::int8_t>& marks) noexcept;

}  // namespace curlew
