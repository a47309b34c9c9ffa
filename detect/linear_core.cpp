#include "detect/linear_core.h"

#include <cmath>

namespace curlew {

LinearCore::LinearCore(Morphology morphology)
    : a_(std::sin(morphology.alpha_rad) * std::cos(morphology.beta_rad)),
      b_(std::sin(morphology.alpha_rad) * std::sin(morphology.beta_rad)),
      c_(std::cos(morphology.alpha_rad)) {}

std::array<double, 2> LinearCore::lenslet_slopes(double dx, double dy) const {
  // Over a unit square the means of x² and y² are 1/12 more than at its centre, and A₊ + A₋ = 2.
  const double light = (1.0 + a_) * dx * dx - 2.0 * b_ * dx * dy + (1.0 - a_) * dy * dy + 1.0 / 6.0;
  return {-c_ * dy / light, c_ * dx / light};
}

double LinearCore::circulation(double t, double u) const {
  const auto s00 = lenslet_slopes(-0.5 - t, -0.5 - u);
  const auto s01 = lenslet_slopes(0.5 - t, -0.5 - u);
  const auto s10 = lenslet_slopes(-0.5 - t, 0.5 - u);
  const auto s11 = lenslet_slopes(0.5 - t, 0.5 - u);
  return 0.5 * (s00[0] + s01[0] + s01[1] + s11[1] - s11[0] - s10[0] - s10[1] - s00[1]);
}

double LinearCore::peak_circulation() const { return 48.0 * c_ / (16.0 - 9.0 * b_ * b_); }

}  // namespace curlew
