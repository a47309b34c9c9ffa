// The phase and the slopes of round vortices, at the centres of lenslets.
#pragma once

#include <cstddef>

#include "core/image.h"

namespace curlew {

/// A round vortex, φ = charge·arg(z − z_vortex).
struct PointVortex {
  float x = 0;  ///< lenslet units
  float y = 0;
  float charge = 1;  ///< +1 or −1
};

/// phase: Σφ of n vortices wrapped into [−π, π], rad, within 2e-5; 0 at a vortex itself.
/// slope_x, slope_y: its gradient softened at the core, Σ charge·(−y, x)/(r² + softening), rad per
/// pitch. It turns round the vortex as a lenslet's mean of the intensity-weighted gradient does,
/// and has no divergence either. All [rows, cols]. softening: pitches², more than 0.
void evaluate_vortices(const PointVortex* vortices, std::size_t n, float softening,
                       Image<float>& phase, Image<float>& slope_x, Image<float>& slope_y) noexcept;

}  // namespace curlew
