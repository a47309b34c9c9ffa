#include "detect/vortex_kernel.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

namespace curlew {
namespace {

double squared(double value) { return value * value; }

/// Returns ln(1 + r), where 1 + r is also given as `whole`. It is accurate both near 1 and near 0.
double log_of_ratio(double whole, double r) {
  return std::abs(r) < 0.5 ? std::log1p(r) : std::log(whole);
}

}  // namespace

VortexKernel::VortexKernel(Morphology morphology) {
  double alpha = std::remainder(morphology.alpha_rad, 2.0 * std::numbers::pi);
  double beta = morphology.beta_rad;
  if (alpha < 0.0) {  // (−α, β) and (α, β+π) have the same A, B and C.
    alpha = -alpha;
    beta += std::numbers::pi;
  }
  const std::complex<double> xi = std::polar(std::cos(0.5 * alpha), 0.5 * beta);
  const std::complex<double> zeta = std::polar(std::sin(0.5 * alpha), -0.5 * beta);
  xi_re_ = xi.real();
  xi_im_ = xi.imag();
  zeta_re_ = zeta.real();
  zeta_im_ = zeta.imag();
  sin_alpha_ = std::sin(alpha);
  b_ = sin_alpha_ * std::sin(beta);
  // These are 1 ∓ sin α cos β without cancellation: 1 − sin α = 2 sin²(π/4 − α/2).
  const double one_minus_sin_alpha = 2.0 * squared(std::sin(0.25 * std::numbers::pi - 0.5 * alpha));
  a_plus_ = one_minus_sin_alpha + 2.0 * sin_alpha_ * squared(std::cos(0.5 * beta));
  a_minus_ = one_minus_sin_alpha + 2.0 * sin_alpha_ * squared(std::sin(0.5 * beta));
  // A₊A₋ = B² + C² and A± ≤ 2, so that A± ≥ C²/2. Together with a C that is never 0, this keeps
  // every quotient below finite on the limit line α = 90°.
  c_ = std::copysign(std::max(std::abs(std::cos(alpha)), 1e-20), std::cos(alpha));
  a_plus_ = std::max(a_plus_, 0.5 * c_ * c_);
  a_minus_ = std::max(a_minus_, 0.5 * c_ * c_);
}

std::array<double, 2> VortexKernel::gradient(double x, double y) const {
  const double q = (squared(a_plus_ * x - b_ * y) + squared(c_ * y)) / a_plus_;
  return {-y * c_ / q, x * c_ / q};
}

/// Returns P(X, Y), whose alternating sum over a rectangle's corners is the integral of ∇φ over it.
std::array<double, 2> VortexKernel::corner_integral(double x, double y) const {
  double x_part_x = 0.0;  // terms with a factor X, which vanish with it
  double x_theta = 0.0;
  double y_part_y = 0.0;
  double y_theta = 0.0;
  if (x != 0.0) {
    // Q/(A₊X²) = (1 − BY/(A₊X))² + (CY/(A₊X))² is the ratio of which the logarithm is taken.
    const double slant = y / (a_plus_ * x);
    const double whole = squared(1.0 - b_ * slant) + squared(c_ * slant);
    const double r = slant * (a_plus_ * a_minus_ * slant - 2.0 * b_);
    const double theta = std::atan2(c_ * x * y, x * (a_plus_ * x - b_ * y));
    x_theta = x * theta;
    x_part_x = -(0.5 * c_ * x * log_of_ratio(whole, r) + b_ * x_theta) / a_minus_;
  }
  if (y != 0.0) {
    const double slant = x / (a_minus_ * y);
    const double whole = squared(1.0 - b_ * slant) + squared(c_ * slant);
    const double r = slant * (a_plus_ * a_minus_ * slant - 2.0 * b_);
    const double theta = -std::atan2(c_ * x * y, y * (a_minus_ * y - b_ * x));
    y_theta = y * theta;
    y_part_y = (0.5 * c_ * y * log_of_ratio(whole, r) - b_ * y_theta) / a_plus_;
  }
  return {x_part_x + y_theta, y_part_y + x_theta};
}

std::array<double, 2> VortexKernel::mean_gradient(double x0, double y0, double x1,
                                                  double y1) const {
  const auto p11 = corner_integral(x1, y1);
  const auto p01 = corner_integral(x0, y1);
  const auto p10 = corner_integral(x1, y0);
  const auto p00 = corner_integral(x0, y0);
  const double area = (x1 - x0) * (y1 - y0);
  return {(p11[0] - p01[0] - p10[0] + p00[0]) / area, (p11[1] - p01[1] - p10[1] + p00[1]) / area};
}

std::array<double, 2> VortexKernel::lenslet_slopes(double dx, double dy) const {
  return mean_gradient(dx - 0.5, dy - 0.5, dx + 0.5, dy + 0.5);
}

double VortexKernel::circulation(double t, double u) const {
  const double re = (xi_re_ + zeta_re_) * t + (zeta_im_ - xi_im_) * u;
  const double im = (xi_im_ + zeta_im_) * t + (xi_re_ - zeta_re_) * u;
  const bool far = re * re + im * im > kAsymptoteFrom * kAsymptoteFrom;
  return far ? circulation_asymptote(t, u) : circulation_closed_form(t, u);
}

/// Computes D of circulation.h over the unit lenslets at (±½, ±½) from the cell's centre.
double VortexKernel::circulation_closed_form(double t, double u) const {
  const auto s00 = mean_gradient(-1.0 - t, -1.0 - u, -t, -u);
  const auto s01 = mean_gradient(-t, -1.0 - u, 1.0 - t, -u);
  const auto s10 = mean_gradient(-1.0 - t, -u, -t, 1.0 - u);
  const auto s11 = mean_gradient(-t, -u, 1.0 - t, 1.0 - u);
  return 0.5 * (s00[0] + s01[0] + s01[1] + s11[1] - s11[0] - s10[0] - s10[1] - s00[1]);
}

/// Computes D → Re[(ξ⁴−ζ⁴)/u⁴·(1 + (8/3)·sin α/u²)] with u = ξz + ζz̄ and z = t + iu.
double VortexKernel::circulation_asymptote(double t, double u) const {
  const std::complex<double> xi(xi_re_, xi_im_);
  const std::complex<double> zeta(zeta_re_, zeta_im_);
  const std::complex<double> z(t, u);
  const std::complex<double> w = xi * z + zeta * std::conj(z);
  const std::complex<double> w2 = w * w;
  const std::complex<double> xi2 = xi * xi;
  const std::complex<double> zeta2 = zeta * zeta;
  return ((xi2 * xi2 - zeta2 * zeta2) / (w2 * w2) * (1.0 + (8.0 / 3.0) * sin_alpha_ / w2)).real();
}

double VortexKernel::peak_circulation() const {
  const double t1 = std::atan2(c_, a_plus_ - b_);
  const double t2 = std::atan2(c_, a_minus_ - b_);
  const double t3 = std::atan2(c_, a_plus_ + b_);
  const double t4 = std::atan2(c_, a_minus_ + b_);
  const double a = 0.5 * (a_plus_ - a_minus_);
  const double four = 4.0 * (a * a + c_ * c_);  // 4(1 − B²) without cancellation
  return t1 + t2 + t3 + t4 + (b_ / a_minus_) * (t1 - t3) + (b_ / a_plus_) * (t2 - t4) +
         0.5 * c_ / a_minus_ * std::log(four / squared(a_plus_)) +
         0.5 * c_ / a_plus_ * std::log(four / squared(a_minus_));
}

}  // namespace curlew
