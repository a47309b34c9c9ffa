// A Zernike is one of Zernike's polynomials, in Noll's order.
#pragma once

#include <vector>

namespace curlew {

/// Evaluates one Zernike polynomial Z_j, normalised so that its mean square over the unit disc is
/// 1. The source is R. J. Noll, J. Opt. Soc. Am. 66, 207 (1976), Eqs. (1) and (2).
class Zernike {
 public:
  /// noll: the index j, from 1 (piston) to kLargestNoll. Throws UsageError for any other.
  explicit Zernike(int noll);

  /// Returns Z_j at (x, y) in units of the disc's radius. Angles run from +x towards +y. Outside
  /// the disc the polynomial simply goes on.
  double operator()(double x, double y) const;

  int radial_order() const { return radial_order_; }        ///< Noll's n
  int azimuthal_order() const { return azimuthal_order_; }  ///< Noll's m, never negative

  static constexpr int kLargestNoll = 496;  ///< radial order 30; beyond it the sums lose digits

 private:
  int radial_order_ = 0;
  int azimuthal_order_ = 0;
  bool sine_ = false;
  std::vector<double> coefficients_;  ///< factors of ρ^m · (ρ²)^i, normalisation included
};

}  // namespace curlew
