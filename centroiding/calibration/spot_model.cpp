#include "centroiding/calibration/spot_model.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace curlew {
namespace {

double threshold_of(const SpotView& view, const std::vector<double>& x,
                    const std::vector<double>& y) {
  const double peak = view.total_adu * *std::max_element(x.begin(), x.end()) *
                      *std::max_element(y.begin(), y.end());
  return std::max(view.threshold_adu, view.threshold_relative * peak);
}

}  // namespace

double mean_signal(double light, double threshold, double noise_adu, double adu_per_e) {
  // This is in standard deviations. What is left out beyond it is below 1e-9 standard deviations.
  constexpr double kCertain = 6.0;
  const double u = light - threshold;
  const double sigma = std::sqrt(noise_adu * noise_adu + adu_per_e * std::max(light, 0.0));
  if (std::abs(u) >= kCertain * sigma) return std::max(u, 0.0);
  const double z = u / sigma;
  return 0.5 * u * std::erfc(-z / std::numbers::sqrt2) +
         sigma * std::exp(-0.5 * z * z) / std::sqrt(2.0 * std::numbers::pi);
}

std::vector<double> SpotModel::shares(double centre, int first, int n) const {
  std::vector<double> out(static_cast<std::size_t>(n));
  for (int i = 0; i < n; ++i) out[static_cast<std::size_t>(i)] = share(first + i - centre);
  return out;
}

Image<float> SpotModel::picture(const SpotView& view) const {
  const Window& w = view.window;
  const std::vector<double> x = shares(view.x_px, w.x0, w.w);
  const std::vector<double> y = shares(view.y_px, w.y0, w.h);
  Image<float> pixels(w.h, w.w);
  for (int r = 0; r < w.h; ++r) {
    for (int c = 0; c < w.w; ++c) {
      pixels(r, c) = static_cast<float>(view.total_adu * y[static_cast<std::size_t>(r)] *
                                        x[static_cast<std::size_t>(c)]);
    }
  }
  return pixels;
}

SpotMoments SpotModel::moments(const SpotView& view) const {
  const Window& w = view.window;
  const std::vector<double> x = shares(view.x_px, w.x0, w.w);
  const std::vector<double> y = shares(view.y_px, w.y0, w.h);
  const double threshold = threshold_of(view, x, y);
  double sum = 0.0;
  double sum_x = 0.0;
  double sum_y = 0.0;
  double sum_rr = 0.0;  // measured from the window's first pixel
  for (int r = 0; r < w.h; ++r) {
    const double row_adu = view.total_adu * y[static_cast<std::size_t>(r)];
    for (int c = 0; c < w.w; ++c) {
      const double signal = mean_signal(row_adu * x[static_cast<std::size_t>(c)], threshold,
                                        view.noise_adu, view.adu_per_e);
      sum += signal;
      sum_x += signal * c;
      sum_y += signal * r;
      sum_rr += signal * (c * c + r * r);
    }
  }
  if (sum <= 0.0) return {};
  const double mean_x = sum_x / sum;
  const double mean_y = sum_y / sum;
  return {sum, w.x0 + mean_x, w.y0 + mean_y, sum_rr / sum - mean_x * mean_x - mean_y * mean_y};
}

double SpotModel::total_for_flux(const SpotView& view, double flux_adu) const {
  const std::vector<double> x = shares(view.x_px, view.window.x0, view.window.w);
  const std::vector<double> y = shares(view.y_px, view.window.y0, view.window.h);
  // The flux is convex in the light, because ever more pixels rise above the threshold. Once
  // Newton's steps are above the solution, they come down to it.
  constexpr int kMaxSteps = 30;
  constexpr double kClose = 1e-9;
  SpotView bright = view;
  bright.total_adu = flux_adu + view.threshold_adu * view.window.w * view.window.h;
  for (int step = 0; step < kMaxSteps; ++step) {
    const double threshold = threshold_of(bright, x, y);
    double flux = 0.0;
    double slope = 0.0;
    for (const double row : y) {
      for (const double column : x) {
        const double share = row * column;
        const double signal = bright.total_adu * share - threshold;
        if (signal <= 0.0) continue;
        flux += signal;
        slope += threshold > view.threshold_adu ? signal / bright.total_adu : share;
      }
    }
    if (slope <= 0.0) {
      bright.total_adu *= 4.0;  // Nothing exceeds the threshold yet.
      continue;
    }
    if (std::abs(flux - flux_adu) <= kClose * flux_adu) break;
    bright.total_adu += (flux_adu - flux) / slope;
  }
  return bright.total_adu;
}

WindowGain SpotModel::window_gain(const SpotView& view) const {
  constexpr double kShiftPx = 0.05;
  const auto moved = [&](double dx, double dy) {
    SpotView shifted = view;
    shifted.x_px += dx;
    shifted.y_px += dy;
    return moments(shifted);
  };
  const SpotMoments right = moved(kShiftPx, 0.0);
  const SpotMoments left = moved(-kShiftPx, 0.0);
  const SpotMoments down = moved(0.0, kShiftPx);
  const SpotMoments up = moved(0.0, -kShiftPx);
  if (std::min({right.flux_adu, left.flux_adu, down.flux_adu, up.flux_adu}) <= 0.0) return {};
  return {(right.x_px - left.x_px) / (2.0 * kShiftPx), (down.y_px - up.y_px) / (2.0 * kShiftPx)};
}

}  // namespace curlew
