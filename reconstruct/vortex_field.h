// This file declares the phase and the slopes of round vortices at the centres of lenslets.
#pragma once

#include <cstddef>

#include "core/image.h"

namespace curlew {

/// This is a round vortex, φ = charge·arg(z − z_vortex).
struct PointVortex {
  float x = 0;  ///< in lenslet units
  float y = 0;
  float charge = 1;  ///< +1 or −1
};

/// Computes the phase and the slopes of n vortices, all [rows, cols]. `phase` is Σφ wrapped into
/// [−π, π], in rad, within 2e-5; it is 0 at a vortex itself. slope_x and slope_y are its gradient
/// softened at the core, Σ charge·(−y, x)/(r² + softening), in rad per pitch. They turn round the
/// vortex as a lenslet's mean of the intensity-weighted gradient does, and have no divergence
/// either. `softening` is in pitches² and more than 0.
void evaluate_vortices(const PointVortex* vortices, std::size_t n, float softening,
                       Image<float>& phase, Image<float>& slope_x, Image<float>& slope_y) noexcept;

}  // namespace curlew
