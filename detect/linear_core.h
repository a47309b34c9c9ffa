// A vortex as a real sensor sees it: slopes weighted by the intensity, which vanishes at its core.
#pragma once

#include <array>

#include "detect/vortex_kernel.h"

namespace curlew {

/// The response of lenslets to a vortex whose amplitude is linear, |u| with u = ξz + ζz̄, when a
/// slope is the intensity-weighted mean gradient ∫I∇φ/∫I, which is what a centroid measures over a
/// window without end. Lengths are in lenslet pitches, as in VortexKernel.
///
/// Exact and short, because I = |u|² = Q and I∇φ = C·(−y, x) are polynomials: over the lenslet
/// centred at (x, y) the slope is C·(−y, x)/(Q(x, y) + 1/6), Q = A₊x² − 2Bxy + A₋y².
class LinearCore {
 public:
  explicit LinearCore(Morphology morphology = {});

  /// Slopes (s_x, s_y), rad per pitch, of the lenslet whose centre lies at (dx, dy) from the
  /// vortex.
  std::array<double, 2> lenslet_slopes(double dx, double dy) const;

  /// Circulation D, rad, of the cell from whose centre the vortex is (t, u) away.
  double circulation(double t, double u) const;

  /// D(0, 0) = 48 C/(16 − 9 B²): 3 for a round core, and nearer to 0 the longer the core.
  double peak_circulation() const;

 private:
  double a_;  // sin α cos β
  double b_;  // sin α sin β
  double c_;  // cos α
};

}  // namespace curlew
