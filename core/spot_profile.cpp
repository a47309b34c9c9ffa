#include "core/spot_profile.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>

namespace curlew {
namespace {

constexpr double kPi = std::numbers::pi;

double sinc(double x) { return x == 0.0 ? 1.0 : std::sin(kPi * x) / (kPi * x); }

}  // namespace

SpotProfile::SpotProfile(double diffraction_px, double blur_px) {
  constexpr double kMinBlurOfPointPx = 0.2;
  constexpr double kBlurPassesTo = 1.2;  // in units of 1/σ: exp(−2π²·1.44) = 5e-13
  constexpr std::size_t kIntervals = 256;
  const double d = diffraction_px > 0.0 ? diffraction_px : 0.0;
  const double blur = d > 0.0 ? blur_px : std::max(blur_px, kMinBlurOfPointPx);
  const double passed_by_blur = blur > 0.0 ? kBlurPassesTo / blur : 0.0;
  const double passed_by_lenslet = d > 0.0 ? 1.0 / d : passed_by_blur;
  const double last = blur > 0.0 ? std::min(passed_by_lenslet, passed_by_blur) : passed_by_lenslet;
  step_ = last / static_cast<double>(kIntervals);
  weight_.resize(kIntervals + 1);
  for (std::size_t i = 0; i <= kIntervals; ++i) {
    const double f = step_ * static_cast<double>(i);
    const double passes =
        (1.0 - f * d) * sinc(f) * std::exp(-2.0 * kPi * kPi * blur * blur * f * f);
    const double simpson = i == 0 || i == kIntervals ? 1.0 : (i % 2 == 1 ? 4.0 : 2.0);
    weight_[i] = 2.0 * passes * simpson * step_ / 3.0;
  }
}

double SpotProfile::share(double x_px) const {
  // The recursion is cos(nφ) = 2·cos(φ)·cos((n−1)φ) − cos((n−2)φ).
  const double twice = 2.0 * std::cos(2.0 * kPi * step_ * x_px);
  double before = 0.5 * twice;
  double now = 1.0;
  double sum = 0.0;
  for (const double weight : weight_) {
    sum += weight * now;
    const double next = twice * now - before;
    before = now;
    now = next;
  }
  return sum;
}

void CoreSums::add(double light_in_pixel, double x, double sigma) {
  const double weighted = light_in_pixel * std::exp(-0.5 * x * x / (sigma * sigma));
  light += weighted;
  first += weighted * x;
  second += weighted * x * x;
}

double CoreSums::variance() const {
  if (!(light > 0.0)) return std::numeric_limits<double>::quiet_NaN();
  const double middle = first / light;
  return second / light - middle * middle;
}

double core_variance(const SpotProfile& profile, double d_px, double first_px, int n,
                     double pitch_px) {
  CoreSums sums;
  for (int i = 0; i < n; ++i) {
    const double x = first_px + i;
    if (std::abs(x) > kCoreReach * d_px + 1e-6) continue;
    double light = profile.share(x);
    if (pitch_px > 0.0) light += profile.share(x - pitch_px) + profile.share(x + pitch_px);
    sums.add(light, x, kCoreWidth * d_px);
  }
  return sums.variance();
}

}  // namespace curlew
