// This finds the vortices of a sampled field.
#pragma once

#include <vector>

#include "acquisition/simulator/field.h"

namespace curlew {

/// Returns the vortices of a sampled field, in order of rows, then columns. The winding of each 2×2
/// plaquette tells whether it has one, which is placed at the zero of the field's bilinear
/// interpolation. Each has charge +1 or −1 and α = β = 0 (not measured). Over a field that is
/// periodic, with its first row and column repeated at the end, the charges add up to 0 exactly.
/// Opposite vortices within one plaquette are not seen.
std::vector<SceneVortex> find_field_vortices(const SampledField& field);

}  // namespace curlew
