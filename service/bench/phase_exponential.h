// The complex-exponential reconstructor: a phase with its vortices, from the slopes alone.
#pragma once

#include <vector>

#include "core/image.h"
#include "core/slope_field.h"
#include "reconstruct/vortex_field.h"

namespace curlew {

/// Follows D. L. Fried, Opt. Commun. 200, 43 (2001): phasors are fitted instead of phases, so that
/// 2π does not count and vortices come by themselves. The phasors u at lenslet centres make Σ
/// w_ab·|u_a·exp(iΔ_ab) − u_b|² least, where Δ is the mean slope of two neighbours and w the root
/// of the product of their fluxes. They are the eigenvector of the normalised problem after
/// `iterations` power steps, and then after iterations/10 sweeps with |u| = 1. Returns the residues
/// of the differences between neighbours, taken the short way round, at the middles of their cells.
/// All lenslets take part, valid or not.
std::vector<PointVortex> vortices_of_exponential(const SlopeField& slopes,
                                                 const Image<float>& flux_adu,
                                                 int iterations = 300);

}  // namespace curlew
