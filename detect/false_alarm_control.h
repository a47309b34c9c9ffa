// False-alarm control: which cells stand out of the slopes' noise, whatever ranks them.
#pragma once

#include <cstdint>

#include "core/image.h"
#include "core/vortex.h"

namespace curlew {

/// Fills `marks`, of the map's size: the sign of D where the cell is valid and |D| exceeds
/// threshold_sigmas·σ_D, else 0. With threshold_sigmas() of a rate (false_alarms.h), or
/// CirculationPlan's for the cells valid in the frame, a detector that reports a vortex only at a
/// cell marked with its sign, and at most one of several side by side, makes that many false alarms
/// a frame in slope noise at most.
void mark_significant(const CirculationMap& map, float threshold_sigmas,
                      Image<std::int8_t>& marks) noexcept;

}  // namespace curlew
