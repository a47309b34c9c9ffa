// The vortices of a sampled field.
#pragma once

#include <vector>

#include "acquisition/simulator/field.h"

namespace curlew {

/// The vortices of a sampled field: the winding of each 2×2 plaquette, placed at the zero of the
/// field's bilinear interpolation. In order of rows, then columns. Each has charge +1 or −1 and
/// α = β = 0 (not measured). Over a field that is periodic, its first row and column repeated at
/// the end, the charges add up to 0 exactly. Opposite vortices within one plaquette are not seen.
std::vector<SceneVortex> find_field_vortices(const SampledField& field);

}  // namespace curlew
