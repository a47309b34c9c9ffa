// SpotProfile is the light of a square lenslet's spot along one axis of the detector.
#pragma once

#include <vector>

namespace curlew {

/// SpotProfile is the spot of a square, evenly lit lenslet, sinc²(x/d)·sinc²(y/d) with d = λ·f·m/w
/// (J. W. Goodman, Introduction to Fourier Optics, 2005, sec. 4.4.1), blurred by a Gaussian and
/// integrated over square pixels. The light in a pixel whose centre lies x from the spot's is,
/// along each axis and over the frequencies f that the lenslet passes,
///     P(x) = 2 ∫₀^{1/d} (1 − f·d)·sinc(f)·exp(−2π²σ²f²)·cos(2πfx) df.
class SpotProfile {
 public:
  /// Both lengths are in px, and diffraction_px is d. Where d is not positive the spot is the
  /// Gaussian alone, whose blur is then at least 0.2 px.
  SpotProfile(double diffraction_px, double blur_px);

  /// Returns the share of the light in a column (or row) of pixels whose centre is x_px from the
  /// spot's.
  double share(double x_px) const;

 private:
  double step_ = 0.0;           // step between frequencies, cycles per px
  std::vector<double> weight_;  // weights of the frequencies, times those of the quadrature
};

/// The core of a spot is its light times a Gaussian of this width about the reference, in units of
/// λ/w. Pixels farther than the reach along an axis are left out.
inline constexpr double kCoreWidth = 0.6;
inline constexpr double kCoreReach = 1.75;

/// CoreSums holds what a core's width follows from, along one axis: sums of light·weight, of that
/// times x, and times x². Lengths are in any unit. The variance of a Gaussian spot's core does not
/// depend on where it lies, and neither skirts of a spot nor errors of the level weigh much in it.
struct CoreSums {
  double light = 0.0;
  double first = 0.0;
  double second = 0.0;

  void add(double light_in_pixel, double x, double sigma);
  /// Returns the variance, which is NaN where there is no light.
  double variance() const;
};

/// Returns the variance of the core of a modelled spot in px², for pixels whose centres are
/// first_px
/// + i from the spot's, i = 0 … n − 1. d_px is λ/w. Where pitch_px is positive, an equally bright
/// spot lies at that distance to either side.
double core_variance(const SpotProfile& profile, double d_px, double first_px, int n,
                     double pitch_px = 0.0);

}  // namespace curlew
