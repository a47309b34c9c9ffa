// kCorrelation; see centroid_methods.h.
// Compiled anew for every instruction set: the guard is Highway's.
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

inline void find_correlation(const CentroidPlan& plan, const Windows& windows,
                             GroupPositions& found) {
  alignas(64) WindowBuffer smooth;  // not cleared: only what is written is read
  alignas(64) WindowBuffer rows;
  const WindowGroup& group = windows.group;
  const std::size_t lanes = lane_count();
  const float s = plan.spot_sigma_px;
  std::array<float, 2 * kMaxSide> g{};  // by distance
  constexpr float kReach = 3.5F;
  const auto reach = std::min(static_cast<std::size_t>(kReach * s) + 1, kMaxSide - 1);
  for (std::size_t i = 0; i <= reach; ++i) {
    const auto u = static_cast<float>(i) / s;
    g[i] = std::exp(-0.5F * u * u);
  }
  // along x, then along y
  for (std::size_t i = 0; i < windows.h; ++i) {
    for (std::size_t j = 0; j < windows.w; ++j) {
      V sum = hn::Zero(d);
      const std::size_t last = std::min(j + reach, windows.w - 1);
      for (std::size_t t = j > reach ? j - reach : 0; t <= last; ++t)
        sum = hn::MulAdd(windows.at(i, t), set(g[t > j ? t - j : j - t]), sum);
      hn::StoreU(sum, d, rows.data() + (i * windows.w + j) * lanes);
    }
  }
  V peak = set(-1e30F), peak_x = hn::Zero(d), peak_y = hn::Zero(d);
  const V width = load(group.width), height = load(group.height);
  for (std::size_t i = 0; i < windows.h; ++i) {
    const V row = set(static_cast<float>(i));
    const M in_height = hn::Lt(row, height);
    const std::size_t first = i > reach ? i - reach : 0;
    const std::size_t last = std::min(i + reach, windows.h - 1);
    for (std::size_t j = 0; j < windows.w; ++j) {
      V sum = hn::Zero(d);
      for (std::size_t t = first; t <= last; ++t) {
        sum = hn::MulAdd(hn::LoadU(d, rows.data() + (t * windows.w + j) * lanes),
                         set(g[t > i ? t - i : i - t]), sum);
      }
      hn::StoreU(sum, d, smooth.data() + (i * windows.w + j) * lanes);
      const V col = set(static_cast<float>(j));
      const M better = hn::And(hn::And(hn::Gt(sum, peak), in_height), hn::Lt(col, width));
      peak = hn::IfThenElse(better, sum, peak);
      peak_x = hn::IfThenElse(better, col, peak_x);
      peak_y = hn::IfThenElse(better, row, peak_y);
    }
  }
  store(peak_x, found.x);
  store(peak_y, found.y);
  store(peak, found.signal);

  // The parabola, and its derivatives by every pixel: dx/dI = Σ_m a_m·g(p − m), m = −1, 0, 1.
  struct Parabola {
    float offset;
    float a[3];
  };
  const auto fit = [](float before, float at, float after) -> Parabola {
    float value[3] = {before, at, after};
    float derivative[3] = {1.0F, 1.0F, 1.0F};
    if (std::min({before, at, after}) > 0.0F) {
      for (int m = 0; m < 3; ++m) {
        derivative[m] = 1.0F / value[m];
        value[m] = std::log(value[m]);
      }
    }
    const float curvature = value[0] - 2.0F * value[1] + value[2];
    if (!(curvature < 0.0F)) return {0.0F, {0.0F, 0.0F, 0.0F}};
    const float offset = 0.5F * (value[0] - value[2]) / curvature;
    const auto a = [&](int m, float slope, float bend) {
      return derivative[m] * (slope - bend * offset) / curvature;
    };
    return {offset, {a(0, 0.5F, 1.0F), a(1, 0.0F, -2.0F), a(2, -0.5F, 1.0F)}};
  };
  for (std::size_t lane = 0; lane < group.n; ++lane) {
    const auto w = static_cast<std::size_t>(group.width[lane]);
    const auto h = static_cast<std::size_t>(group.height[lane]);
    const auto px = static_cast<std::size_t>(found.x[lane]);
    const auto py = static_cast<std::size_t>(found.y[lane]);
    const auto at = [&](std::size_t i, std::size_t j) {
      return smooth[(i * windows.w + j) * lanes + lane];
    };
    const Parabola none{0.0F, {0.0F, 0.0F, 0.0F}};
    const bool inner_x = px > 0 && px + 1 < w;
    const bool inner_y = py > 0 && py + 1 < h;
    const Parabola x = inner_x ? fit(at(py, px - 1), at(py, px), at(py, px + 1)) : none;
    const Parabola y = inner_y ? fit(at(py - 1, px), at(py, px), at(py + 1, px)) : none;
    float qxx = 0.0F, qyy = 0.0F, qxy = 0.0F, q = 0.0F;
    const auto weight = [&](std::size_t p, std::size_t m) {
      const std::size_t distance = p > m ? p - m : m - p;
      return distance <= reach ? g[distance] : 0.0F;
    };
    const auto slope = [&](const Parabola& fitted, bool inner, std::size_t p, std::size_t m) {
      return inner ? fitted.a[0] * weight(p, m - 1) + fitted.a[1] * weight(p, m) +
                         fitted.a[2] * weight(p, m + 1)
                   : 0.0F;
    };
    for (std::size_t i = 0; i < h; ++i) {
      const float g_y = weight(i, py);
      const float slope_y = slope(y, inner_y, i, py);
      for (std::size_t j = 0; j < w; ++j) {
        const float light = windows.light[(i * windows.w + j) * lanes + lane];
        const float variance = std::max(light, 0.0F) * plan.counts_per_e + plan.pixel_variance;
        const float g_x = weight(j, px);
        const float dx = slope(x, inner_x, j, px) * g_y;
        const float dy = slope_y * g_x;
        qxx += variance * dx * dx;
        qyy += variance * dy * dy;
        qxy += variance * dx * dy;
        q += variance * g_x * g_x * g_y * g_y;
      }
    }
    found.x[lane] += std::clamp(x.offset, -1.0F, 1.0F) - group.half_x[lane];
    found.y[lane] += std::clamp(y.offset, -1.0F, 1.0F) - group.half_y[lane];
    // Where there is no parabola the peak may be anywhere in its pixel.
    found.variance_x[lane] = inner_x ? qxx : 1.0F / 12.0F;
    found.variance_y[lane] = inner_y ? qyy : 1.0F / 12.0F;
    found.covariance[lane] = inner_x && inner_y ? qxy : 0.0F;
    found.signal_variance[lane] = q;
    found.flux[lane] = 2.0F * found.signal[lane];
  }
}

}  // namespace curlew::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // per target
