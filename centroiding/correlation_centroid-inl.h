// This file finds positions by kCorrelation, which centroid_methods.h describes.
// Highway compiles it anew for every instruction set, which is why the include guard toggles.
#if defined(CURLEW_CORRELATION_CENTROID_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef CURLEW_CORRELATION_CENTROID_INL_H_
#undef CURLEW_CORRELATION_CENTROID_INL_H_
#else
#define CURLEW_CORRELATION_CENTROID_INL_H_
#endif

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "centroiding/window_lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace curlew::HWY_NAMESPACE {

/// This is a Gaussian of height 1, sampled at whole pixels from its middle. It ends kSigmas from
/// there.
struct SampledGaussian {
  static constexpr float kSigmas = 3.5F;

  explicit SampledGaussian(float sigma_px)
      : reach(std::min(static_cast<std::size_t>(kSigmas * sigma_px) + 1, kMaxSide - 1)) {
    for (std::size_t i = 0; i <= reach; ++i) {
      const auto u = static_cast<float>(i) / sigma_px;
      value[i] = std::exp(-0.5F * u * u);
    }
  }

  static std::size_t distance(std::size_t a, std::size_t b) { return a > b ? a - b : b - a; }
  /// Returns the value at pixel p of the Gaussian about pixel `middle`.
  float at(std::size_t p, std::size_t middle) const {
    return distance(p, middle) <= reach ? value[distance(p, middle)] : 0.0F;
  }

  std::size_t reach;
  std::array<float, 2 * kMaxSide> value{};  ///< It is indexed by the distance from the middle.
};

/// Weighs a line of n pixels, which lie `step` floats apart, with the Gaussian about pixel p and
/// returns the sum.
inline V correlate_line(const float* line, std::size_t step, std::size_t n, std::size_t p,
                        const SampledGaussian& gaussian) {
  V sum = hn::Zero(d);
  const std::size_t last = std::min(p + gaussian.reach, n - 1);
  for (std::size_t t = p > gaussian.reach ? p - gaussian.reach : 0; t <= last; ++t) {
    const V weight = set(gaussian.value[SampledGaussian::distance(t, p)]);
    sum = hn::MulAdd(hn::LoadU(d, line + t * step), weight, sum);
  }
  return sum;
}

/// Correlates the windows with the Gaussian, first along x and then along y.
inline void correlate(const Windows& windows, const SampledGaussian& gaussian,
                      WindowBuffer& correlation) {
  alignas(64) WindowBuffer along_x;  // It is not cleared, for only what is written is read.
  const std::size_t lanes = lane_count();
  const std::size_t row_step = windows.w * lanes;
  for (std::size_t i = 0; i < windows.h; ++i) {
    const float* row = windows.light + i * row_step;
    for (std::size_t j = 0; j < windows.w; ++j) {
      const V sum = correlate_line(row, lanes, windows.w, j, gaussian);
      hn::StoreU(sum, d, along_x.data() + i * row_step + j * lanes);
    }
  }
  for (std::size_t i = 0; i < windows.h; ++i) {
    for (std::size_t j = 0; j < windows.w; ++j) {
      const float* column = along_x.data() + j * lanes;
      const V sum = correlate_line(column, row_step, windows.h, i, gaussian);
      hn::StoreU(sum, d, correlation.data() + i * row_step + j * lanes);
    }
  }
}

/// Finds the brightest pixel of each lenslet's correlation. Its position is counted from the
/// window's first pixel.
inline void find_peaks(const Windows& windows, const WindowBuffer& correlation,
                       GroupPositions& found) {
  const std::size_t lanes = lane_count();
  const V width = load(windows.group.width), height = load(windows.group.height);
  V peak = set(-1e30F), peak_x = hn::Zero(d), peak_y = hn::Zero(d);
  for (std::size_t i = 0; i < windows.h; ++i) {
    const V row = set(static_cast<float>(i));
    const M in_height = hn::Lt(row, height);
    for (std::size_t j = 0; j < windows.w; ++j) {
      const V value = hn::LoadU(d, correlation.data() + (i * windows.w + j) * lanes);
      const V col = set(static_cast<float>(j));
      const M better = hn::And(hn::And(hn::Gt(value, peak), in_height), hn::Lt(col, width));
      peak = hn::IfThenElse(better, value, peak);
      peak_x = hn::IfThenElse(better, col, peak_x);
      peak_y = hn::IfThenElse(better, row, peak_y);
    }
  }
  store(peak_x, found.x);
  store(peak_y, found.y);
  store(peak, found.signal);
}

/// This describes a parabola through the peak and its two neighbours along an axis.
struct Parabola {
  float offset = 0.0F;  ///< The vertex lies this far from the peak's pixel.
  /// These are the derivatives of the offset by the three correlations, in their order.
  std::array<float, 3> derivative{};
};

/// Fits the parabola through the logarithms, or through the values themselves where one of them is
/// not positive. Where the three do not bend down, the peak's pixel stays the best guess.
inline Parabola fit_parabola(float before, float at, float after) {
  std::array<float, 3> value{before, at, after};
  std::array<float, 3> slope{1.0F, 1.0F, 1.0F};
  if (std::min({before, at, after}) > 0.0F) {
    for (std::size_t m = 0; m < 3; ++m) {
      slope[m] = 1.0F / value[m];
      value[m] = std::log(value[m]);
    }
  }
  const float curvature = value[0] - 2.0F * value[1] + value[2];
  if (!(curvature < 0.0F)) return {};
  const float offset = 0.5F * (value[0] - value[2]) / curvature;
  const auto derivative = [&](std::size_t m, float tilt, float bend) {
    return slope[m] * (tilt - bend * offset) / curvature;
  };
  return {offset,
          {derivative(0, 0.5F, 1.0F), derivative(1, 0.0F, -2.0F), derivative(2, -0.5F, 1.0F)}};
}

/// This describes a lenslet's peak along one axis.
struct AxisPeak {
  std::size_t pixel;  ///< The peak's pixel is counted from the window's first.
  bool inner;         ///< The peak has a neighbour on either side.
  Parabola parabola;  ///< It is all 0 where the peak is not an inner one.

  /// Returns how much the position along this axis changes with the light of pixel p. The caller
  /// multiplies this by the Gaussian along the other axis. The sum is Σ_m derivative_m·g(p − m)
  /// over the peak and its two neighbours m.
  float slope(const SampledGaussian& gaussian, std::size_t p) const {
    if (!inner) return 0.0F;
    const std::array<float, 3>& a = parabola.derivative;
    return a[0] * gaussian.at(p, pixel - 1) + a[1] * gaussian.at(p, pixel) +
           a[2] * gaussian.at(p, pixel + 1);
  }
};

/// These are the variances of a position and of its signal.
struct PeakVariances {
  float xx, yy, xy, signal;
};

/// Sums the noise of all pixels of one lenslet's window, each times the squared derivative of the
/// position by it.
inline PeakVariances propagate_noise(const CentroidPlan& plan, const Windows& windows,
                                     std::size_t lane, const SampledGaussian& gaussian,
                                     const AxisPeak& x, const AxisPeak& y) {
  const std::size_t lanes = lane_count();
  const auto w = static_cast<std::size_t>(windows.group.width[lane]);
  const auto h = static_cast<std::size_t>(windows.group.height[lane]);
  float xx = 0.0F, yy = 0.0F, xy = 0.0F, signal = 0.0F;
  for (std::size_t i = 0; i < h; ++i) {
    const float g_y = gaussian.at(i, y.pixel);
    const float slope_y = y.slope(gaussian, i);
    for (std::size_t j = 0; j < w; ++j) {
      const float light = windows.light[(i * windows.w + j) * lanes + lane];
      const float variance =
          std::max(light, 0.0F) * plan.counts_per_e + hn::GetLane(windows.constant);
      const float g_x = gaussian.at(j, x.pixel);
      const float dx = x.slope(gaussian, j) * g_y;
      const float dy = slope_y * g_x;
      xx += variance * dx * dx;
      yy += variance * dy * dy;
      xy += variance * dx * dy;
      signal += variance * g_x * g_x * g_y * g_y;
    }
  }
  return {xx, yy, xy, signal};
}

/// Refines the peak along one axis of n pixels, which lie `step` floats apart in the correlation.
/// `peak` points to the correlation at the peak's pixel.
inline AxisPeak refine_axis(const float* peak, std::size_t step, std::size_t pixel, std::size_t n) {
  const bool inner = pixel > 0 && pixel + 1 < n;
  if (!inner) return {pixel, false, {}};
  return {pixel, true, fit_parabola(*(peak - step), *peak, *(peak + step))};
}

/// Puts the parabolas' vertex in the place of one lenslet's peak pixel, relative to the window's
/// centre, and adds the variances.
inline void refine_peak(const CentroidPlan& plan, const Windows& windows,
                        const WindowBuffer& correlation, const SampledGaussian& gaussian,
                        std::size_t lane, GroupPositions& found) {
  // Where there is no parabola the position may be anywhere in the peak's pixel.
  constexpr float kVarianceOfPixel = 1.0F / 12.0F;
  const WindowGroup& group = windows.group;
  const std::size_t lanes = lane_count();
  const auto peak_x = static_cast<std::size_t>(found.x[lane]);
  const auto peak_y = static_cast<std::size_t>(found.y[lane]);
  const float* peak = correlation.data() + (peak_y * windows.w + peak_x) * lanes + lane;
  const AxisPeak x = refine_axis(peak, lanes, peak_x, static_cast<std::size_t>(group.width[lane]));
  const AxisPeak y =
      refine_axis(peak, windows.w * lanes, peak_y, static_cast<std::size_t>(group.height[lane]));
  const PeakVariances variances = propagate_noise(plan, windows, lane, gaussian, x, y);
  found.x[lane] += std::clamp(x.parabola.offset, -1.0F, 1.0F) - group.half_x[lane];
  found.y[lane] += std::clamp(y.parabola.offset, -1.0F, 1.0F) - group.half_y[lane];
  found.variance_x[lane] = x.inner ? variances.xx : kVarianceOfPixel;
  found.variance_y[lane] = y.inner ? variances.yy : kVarianceOfPixel;
  found.covariance[lane] = x.inner && y.inner ? variances.xy : 0.0F;
  found.signal_variance[lane] = variances.signal;
  found.flux[lane] = 2.0F * found.signal[lane];
}

/// Finds the positions of a group's spots by kCorrelation.
inline void find_correlation(const CentroidPlan& plan, const Windows& windows,
                             GroupPositions& found) {
  alignas(64) WindowBuffer correlation;  // It is not cleared, for only what is written is read.
  const SampledGaussian gaussian(plan.spot_sigma_px);
  correlate(windows, gaussian, correlation);
  find_peaks(windows, correlation, found);
  for (std::size_t lane = 0; lane < windows.group.n; ++lane)
    refine_peak(plan, windows, correlation, gaussian, lane, found);
}

}  // namespace curlew::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // per target
