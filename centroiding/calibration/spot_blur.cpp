#include "centroiding/calibration/spot_blur.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <vector>

#include "core/spot_profile.h"

namespace curlew {
namespace {

/// Says where the pixels of a spot's window lie, and how wide its core is.
struct MeasuredCore {
  double first_x_px;  ///< centre of the window's first column from the spot's
  double first_y_px;
  int w;
  int h;
  double variance_px2;  ///< mean of the two axes
};

MeasuredCore measure_core(const Window& window, double x_px, double y_px, double d_px,
                          const Image<float>& light) {
  const double sigma = kCoreWidth * d_px;
  const double reach = kCoreReach * d_px + 1e-6;
  CoreSums along_x;
  CoreSums along_y;
  for (int row = window.y0; row < window.y0 + window.h; ++row) {
    const double y = row - y_px;
    if (std::abs(y) > reach) continue;
    for (int col = window.x0; col < window.x0 + window.w; ++col) {
      const double x = col - x_px;
      if (std::abs(x) > reach) continue;
      const auto value = static_cast<double>(light(row, col));
      along_x.add(value * std::exp(-0.5 * y * y / (sigma * sigma)), x, sigma);
      along_y.add(value * std::exp(-0.5 * x * x / (sigma * sigma)), y, sigma);
    }
  }
  return {window.x0 - x_px, window.y0 - y_px, window.w, window.h,
          0.5 * (along_x.variance() + along_y.variance())};
}

std::vector<MeasuredCore> measure_cores(const Sensor& sensor, const Image<float>& light,
                                        double d_px) {
  constexpr std::size_t kSpots = 64;
  const auto lit = static_cast<std::size_t>(
      std::count(sensor.valid.begin(), sensor.valid.end(), std::uint8_t{1}));
  const std::size_t stride = std::max<std::size_t>(lit / kSpots, 1);
  std::vector<MeasuredCore> cores;
  std::size_t seen = 0;
  for (std::size_t k = 0; k < sensor.valid.size(); ++k) {
    if (sensor.valid[k] == 0 || seen++ % stride != 0) continue;
    const MeasuredCore core =
        measure_core(sensor.window[k], static_cast<double>(sensor.ref_x_px[k]),
                     static_cast<double>(sensor.ref_y_px[k]), d_px, light);
    if (std::isfinite(core.variance_px2)) cores.push_back(core);
  }
  return cores;
}

}  // namespace

double fit_spot_blur_px(const Sensor& sensor, const Image<float>& light) {
  constexpr double kFinest = 0.5;  // px a λ/w
  constexpr double kWidest = 3.0;  // λ/w
  constexpr int kHalvings = 12;
  const double d_px = 2.0 * std::numbers::pi / std::abs(sensor.optics.slope_rad_per_px());
  const double unknown = std::numeric_limits<double>::quiet_NaN();
  if (!(d_px >= kFinest && std::isfinite(d_px))) return unknown;
  const std::vector<MeasuredCore> cores = measure_cores(sensor, light, d_px);
  if (cores.empty()) return unknown;
  const double pitch_px = sensor.grid.pitch_px();
  std::vector<double> excess(cores.size());
  const auto is_too_narrow = [&](double blur_px) {
    const SpotProfile profile(d_px, blur_px);
    std::ranges::transform(cores, excess.begin(), [&](const MeasuredCore& core) {
      return core.variance_px2 -
             0.5 * (core_variance(profile, d_px, core.first_x_px, core.w, pitch_px) +
                    core_variance(profile, d_px, core.first_y_px, core.h, pitch_px));
    });
    const auto middle = excess.begin() + static_cast<std::ptrdiff_t>(excess.size() / 2);
    std::ranges::nth_element(excess, middle);
    return *middle > 0.0;
  };
  if (!is_too_narrow(0.0)) return 0.0;
  double low = 0.0;
  double high = kWidest * d_px;
  for (int i = 0; i < kHalvings; ++i) {
    const double middle = 0.5 * (low + high);
    (is_too_narrow(middle) ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

}  // namespace curlew
