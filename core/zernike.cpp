#include "core/zernike.h"

#include <cmath>
#include <complex>
#include <cstddef>
#include <string>

#include "core/error.h"

namespace curlew {
namespace {

double factorial(int n) { return std::tgamma(static_cast<double>(n) + 1.0); }

}  // namespace

Zernike::Zernike(int noll) {
  if (noll < 1 || noll > kLargestNoll) {
    throw UsageError("the Noll index " + std::to_string(noll) + " is not between 1 and " +
                     std::to_string(kLargestNoll) + "; give one that is");
  }
  int place = noll - 1;  // within its radial order, counted from 0
  while (place > radial_order_) {
    place -= radial_order_ + 1;
    ++radial_order_;
  }
  // Within order n the values of m grow in steps of 2, and those above 0 come twice.
  azimuthal_order_ = radial_order_ % 2 == 0 ? 2 * ((place + 1) / 2) : 2 * (place / 2) + 1;
  sine_ = azimuthal_order_ != 0 && noll % 2 == 1;

  const int n = radial_order_;
  const int m = azimuthal_order_;
  const double norm = std::sqrt((m == 0 ? 1.0 : 2.0) * (n + 1));
  const int terms = (n - m) / 2 + 1;
  coefficients_.resize(static_cast<std::size_t>(terms));
  for (int s = 0; s < terms; ++s) {
    const double sign = s % 2 == 0 ? 1.0 : -1.0;
    coefficients_[static_cast<std::size_t>(terms - 1 - s)] =
        norm * sign * factorial(n - s) /
        (factorial(s) * factorial((n + m) / 2 - s) * factorial((n - m) / 2 - s));
  }
}

double Zernike::operator()(double x, double y) const {
  const double square = x * x + y * y;
  double radial = 0.0;
  for (std::size_t i = coefficients_.size(); i-- > 0;) radial = radial * square + coefficients_[i];
  std::complex<double> power(1.0, 0.0);  // ρ^m e^{imθ}
  for (int i = 0; i < azimuthal_order_; ++i) power *= std::complex<double>(x, y);
  return radial * (sine_ ? power.imag() : power.real());
}

}  // namespace curlew
