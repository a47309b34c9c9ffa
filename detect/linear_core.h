// A LinearCore is a vortex as a real sensor sees it: slopes are weighted by the intensity, which
// vanishes at its core.
#pragma once

#include <array>

#include "detect/vortex_kernel.h"

namespace curlew {

/// Computes the response of lenslets to a vortex whose amplitude is linear, |u| with u = ξz + ζz̄.
/// A slope is here the intensity-weighted mean gradient ∫I∇φ/∫I, which is what a centroid measures
/// over an unlimited window. Lengths are in lenslet pitches, as in VortexKernel.
///
/// The result is exact and short, because I = |u|² = Q and I∇φ = C·(−y, x) are polynomials: over
/// the lenslet centred at (x, y) the slope is C·(−y, x)/(Q(x, y) + 1/6) with Q = A₊x² − 2Bxy +
/// A₋y².
class LinearCore {
 public:
  explicit LinearCore(Morphology morphology = {});

  /// Returns the slopes (s_x, s_y), in rad per pitch, of the lenslet whose centre lies at (dx, dy)
  /// from the vortex.
  std::array<double, 2> lenslet_slopes(double dx, double dy) const;

  /// Returns the circulation D, in rad, of the cell from whose centre the vortex is (t, u) away.
  double circulation(double t, double u) const;

  /// Returns D(0, 0) = 48 C/(16 − 9 B²). It is 3 for a round core, and nearer to 0 the longer the
  /// core.
  double peak_circulation() const;

 private:
  double a_;  // sin α cos β
  double b_;  // sin α sin β
  double c_;  // cos α
};

}  // namespace curlew
