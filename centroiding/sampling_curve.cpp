#include "centroiding/sampling_curve.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "core/as_size.h"

namespace curlew {
namespace {

constexpr double kNarrowestPx = 0.2;   // All light of narrower spots lies in one pixel.
constexpr double kNeedsCurvePx = 0.5;  // Wider spots are less than .003 px off.
constexpr double kWidestPx = 1.0;      // Their cores do not fit into the pixels that are looked at.
constexpr int kReach = 2;              // pixels on either side of the brightest
constexpr int kSteps = 128;

struct Moments {
  double centre_px;
  double variance_px2;
};

/// Returns the moments, over pixels at whole numbers, of a Gaussian at x that is integrated over
/// them.
Moments moments_of(double x, double sigma) {
  const double scale = 1.0 / (sigma * std::numbers::sqrt2);
  double sum = 0.0;
  double sum_x = 0.0;
  double sum_xx = 0.0;
  for (int i = -kReach; i <= kReach; ++i) {
    const double light = 0.5 * (std::erf((i + 0.5 - x) * scale) - std::erf((i - 0.5 - x) * scale));
    sum += light;
    sum_x += light * i;
    sum_xx += light * i * i;
  }
  const double centre = sum_x / sum;
  return {centre, sum_xx / sum - centre * centre};
}

/// Returns where a Gaussian lies whose centre of gravity is at `centre`, both within half a pixel
/// of a pixel's middle.
double place_of(double centre, double sigma) {
  double low = -0.5;
  double high = 0.5;
  for (int i = 0; i < 30; ++i) {
    const double middle = 0.5 * (low + high);
    (moments_of(middle, sigma).centre_px < centre ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

/// Returns the moments along an axis of the light of the pixels round (col, row).
Moments measure_core(const Image<float>& light, int col, int row, bool along_x) {
  double sum = 0.0;
  double sum_x = 0.0;
  double sum_xx = 0.0;
  for (int i = -kReach; i <= kReach; ++i) {
    for (int j = -kReach; j <= kReach; ++j) {
      const auto value =
          static_cast<double>(along_x ? light(row + j, col + i) : light(row + i, col + j));
      sum += value;
      sum_x += value * i;
      sum_xx += value * i * i;
    }
  }
  const double centre = sum_x / sum;
  return {centre, sum_xx / sum - centre * centre};
}

}  // namespace

SamplingCurve::SamplingCurve(const Sensor& sensor) {
  if (!(sensor.spot_gaussian_px < kNeedsCurvePx)) return;
  const double sigma = std::max(sensor.spot_gaussian_px, kNarrowestPx);
  correction_px_.resize(kSteps + 1);
  for (int i = 0; i <= kSteps; ++i) {
    const double centre = static_cast<double>(i) / kSteps - 0.5;
    correction_px_[as_size(i)] = static_cast<float>(place_of(centre, sigma) - centre);
  }
}

float SamplingCurve::true_px(float centre_px) const noexcept {
  if (correction_px_.empty()) return centre_px;
  const float middle = std::nearbyint(centre_px);
  const float at = (centre_px - middle + 0.5F) * static_cast<float>(kSteps);
  const float first = std::clamp(std::floor(at), 0.0F, static_cast<float>(kSteps - 1));
  const float part = at - first;
  const auto i = static_cast<std::size_t>(first);
  return centre_px + (1.0F - part) * correction_px_[i] + part * correction_px_[i + 1];
}

double fit_spot_gaussian_px(const Image<float>& light, const Sensor& sensor) {
  constexpr std::size_t kSpots = 512;
  std::vector<Moments> cores;
  const std::size_t stride = sensor.valid.size() / kSpots + 1;
  for (std::size_t k = 0; k < sensor.valid.size(); k += stride) {
    const Window& window = sensor.window[k];
    if (sensor.valid[k] == 0) continue;
    int col = window.x0;
    int row = window.y0;
    for (int y = window.y0; y < window.y0 + window.h; ++y)
      for (int x = window.x0; x < window.x0 + window.w; ++x)
        if (light(y, x) > light(row, col)) {
          row = y;
          col = x;
        }
    if (row < kReach || col < kReach || row >= light.rows() - kReach ||
        col >= light.cols() - kReach)
      continue;
    for (const bool along_x : {true, false}) {
      const Moments core = measure_core(light, col, row, along_x);
      if (std::abs(core.centre_px) <= 0.5 && core.variance_px2 > 0.0) cores.push_back(core);
    }
  }
  if (cores.empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto excess = [&](double sigma) {
    double sum = 0.0;
    for (const Moments& core : cores)
      sum += core.variance_px2 - moments_of(place_of(core.centre_px, sigma), sigma).variance_px2;
    return sum;
  };
  if (excess(kWidestPx) > 0.0) return std::numeric_limits<double>::quiet_NaN();
  double low = kNarrowestPx;
  double high = kWidestPx;
  for (int i = 0; i < 12; ++i) {
    const double middle = 0.5 * (low + high);
    (excess(middle) > 0.0 ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

}  // namespace curlew
