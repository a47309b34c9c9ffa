// The complex-exponential reconstructor: a phase with its vortices, from the slopes alone.
#pragma once

#include <vector>

#include "core/image.h"
#include "core/slope_field.h"
#include "reconstruct/vortex_field.h"

namespace curlew {

/// After D. L. Fried, Opt. Commun. 200, 43 (2001): not phases but phasors are fitted, so that
/// 2π does not count and vortices come by themselves. Here the phasors u at lenslet centres that
/// make Σ w_ab·|u_a·exp(iΔ_ab) − u_b|² least, Δ the mean slope of two neighbours and w the root of
/// their fluxes' product: the eigenvector of the normalised problem by `iterations` power steps,
/// then as many sweeps/10 with |u| = 1. Returned are the residues of its short differences, at the
/// middle of their cells. All lenslets take part, valid or not.
std::vector<PointVortex> vortices_of_exponential(const SlopeField& slopes,
                                                 const Image<float>& flux_adu,
                                                 int iterations = 300);

}  // namespace curlew
