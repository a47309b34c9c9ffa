// The vortex kernel gives slopes and circulation of one vortex as lenslets that average uniformly
// see it.
#pragma once

#include <array>

namespace curlew {

/// This is the shape of a vortex's core: φ = Im ln[ξ(x+iy) + ζ(x−iy)] with ξ = cos(α/2)·e^{iβ/2}
/// and ζ = sin(α/2)·e^{−iβ/2}. α = 0 is the canonical (round) vortex of charge +1. The charge is
/// the sign of cos α, so that α = π is the round vortex of charge −1. Both angles are in radians.
/// Source: Chen, Roux & Olivier, J. Opt. Soc. Am. A 24, 1994 (2007).
struct Morphology {
  double alpha_rad = 0.0;
  double beta_rad = 0.0;
};

/// Computes the uniform-average response of lenslets to a vortex of one morphology, in closed form.
/// Lengths are in lenslet pitches, x along the columns and y along the rows. A kernel is made once
/// per morphology and used by plans and tests, so that everything is double.
///
/// The absolute error of D is below 5e-13 within a few pitches. As the core degenerates into a line
/// (α towards 90°), the error grows to 5e-12 at 1e-3 rad from there, and it stays below 1e-9 all
/// the way. All results are finite for finite arguments, even on the limit line itself.
class VortexKernel {
 public:
  explicit VortexKernel(Morphology morphology = {});

  /// Returns +1 or −1.
  int charge() const { return c_ > 0.0 ? 1 : -1; }

  /// Returns ∇φ (x, y) in rad per pitch at a point (x, y) from the vortex. It is infinite at (0,
  /// 0).
  std::array<double, 2> gradient(double x, double y) const;

  /// Returns ∇φ (x, y) in rad per pitch, averaged over the rectangle [x0, x1]×[y0, y1]. The
  /// rectangle is given from the vortex, which may lie inside, on a side or on a corner. x0 < x1
  /// and y0 < y1 must hold.
  std::array<double, 2> mean_gradient(double x0, double y0, double x1, double y1) const;

  /// Returns the slopes (s_x, s_y), in rad per pitch, of the lenslet whose centre lies at (dx, dy)
  /// from the vortex.
  std::array<double, 2> lenslet_slopes(double dx, double dy) const;

  /// Returns the circulation D, in rad, of the cell from whose centre the vortex is (t, u) away. It
  /// takes the asymptote where |ξz + ζz̄| > kAsymptoteFrom and the closed form elsewhere. Both are
  /// within 1e-13 of the truth where they meet.
  double circulation(double t, double u) const;

  /// Returns D(0, 0), the circulation of a vortex on the cell's node, from a formula of its own.
  double peak_circulation() const;

  /// These are the two branches of circulation(), for tests of where they meet.
  double circulation_closed_form(double t, double u) const;
  double circulation_asymptote(double t, double u) const;

  /// This is the |u| = |ξz + ζz̄| at which circulation() changes branch. The asymptote's relative
  /// error is O(|u|⁻⁴). Its absolute error, O(|u|⁻⁸), has fallen to the closed form's rounding
  /// (1e-14) here.
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
