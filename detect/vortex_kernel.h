// The vortex kernel: slopes and circulation of one vortex as lenslets average them uniformly.
#pragma once

#include <array>

namespace curlew {

/// Shape of a vortex's core: φ = Im ln[ξ(x+iy) + ζ(x−iy)] with ξ = cos(α/2)·e^{iβ/2} and
/// ζ = sin(α/2)·e^{−iβ/2}. α = 0 is the canonical (round) vortex of charge +1; the charge is the
/// sign of cos α, so α = π is the round one of charge −1. Both angles in radians.
/// Source: Chen, Roux & Olivier, J. Opt. Soc. Am. A 24, 1994 (2007).
struct Morphology {
  double alpha_rad = 0.0;
  double beta_rad = 0.0;
};

/// The uniform-average response of lenslets to a vortex of one morphology, in closed form.
/// Lengths are in lenslet pitches, x along the columns, y along the rows. Made once per morphology
/// and used by plans and tests, so everything is double.
///
/// Absolute error of D below 5e-13 within a few pitches; as the core degenerates into a line (α
/// towards 90°) it grows to 5e-12 at 1e-3 rad from there and stays below 1e-9 all the way. All
/// results are finite for finite arguments, the limit line itself included.
class VortexKernel {
 public:
  explicit VortexKernel(Morphology morphology = {});

  /// +1 or −1.
  int charge() const { return c_ > 0.0 ? 1 : -1; }

  /// ∇φ (x, y) in rad per pitch at a point (x, y) from the vortex; infinite at (0, 0).
  std::array<double, 2> gradient(double x, double y) const;

  /// ∇φ averaged over the rectangle [x0, x1]×[y0, y1], given from the vortex, which may lie inside,
  /// on a side or on a corner. rad per pitch, (x, y). Needs x0 < x1 and y0 < y1.
  std::array<double, 2> mean_gradient(double x0, double y0, double x1, double y1) const;

  /// Slopes (s_x, s_y), rad per pitch, of the lenslet whose centre lies at (dx, dy) from the
  /// vortex.
  std::array<double, 2> lenslet_slopes(double dx, double dy) const;

  /// Circulation D, rad, of the cell from whose centre the vortex is (t, u) away.
  /// Takes the asymptote where |ξz + ζz̄| > kAsymptoteFrom and the closed form elsewhere; both are
  /// within 1e-13 of the truth where they meet.
  double circulation(double t, double u) const;

  /// D(0, 0): the circulation of a vortex on the cell's node, from the formula of its own.
  double peak_circulation() const;

  /// The two branches of circulation(), for tests of their joint.
  double circulation_closed_form(double t, double u) const;
  double circulation_asymptote(double t, double u) const;

  /// |u| = |ξz + ζz̄| at which circulation() changes branch. The asymptote's relative error is
  /// O(|u|⁻⁴), so its absolute error O(|u|⁻⁸) falls to the closed form's rounding (1e-14) here.
  static constexpr double kAsymptoteFrom = 56.0;

 private:
  std::array<double, 2> corner_integral(double x, double y) const;

  double xi_re_, xi_im_, zeta_re_, zeta_im_;
  double sin_alpha_;
  double a_plus_;   // 1 + sin α cos β
  double a_minus_;  // 1 − sin α cos β
  double b_;        // sin α sin β
  double c_;        // cos α
};

}  // namespace curlew
