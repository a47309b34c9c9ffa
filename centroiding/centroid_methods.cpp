// As many lenslets at once as a vector has lanes: a lane is a lenslet. All windows of such a group
// are read into one buffer, pixel by pixel, and no sum ever runs across lanes.
#include "centroiding/centroid_methods.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "centroiding/centroid_methods.cpp"
#include "hwy/foreach_target.h"
// foreach_target.h comes first.

#include "hwy/contrib/math/math-inl.h"
#include "hwy/highway.h"

#ifndef CURLEW_CENTROID_METHODS_ONCE
#define CURLEW_CENTROID_METHODS_ONCE
namespace curlew {
namespace {

constexpr std::size_t kMaxLanes = 16;
constexpr std::size_t kMaxSide = kMaxMethodWindow;
constexpr int kWeightedSteps = 3;
constexpr int kLikelihoodSteps = 6;
// What a bad pixel holds, and one beyond the lenslet's window: nothing, or, for the fit, which
// would take that for darkness, what no pixel can.
constexpr float kNothing = 0.0F;
constexpr float kBad = -1e30F;

/// A value a lenslet.
using Row = std::array<float, kMaxLanes>;

/// What a method says of a group's lenslets. Positions are relative to the windows' centres.
struct Found {
  alignas(64) Row x, y, variance_x, variance_y, covariance;
  alignas(64) Row signal, signal_variance;  ///< what min_snr is asked of
  alignas(64) Row flux;                     ///< of a Gaussian spot of this signal, counts
};

/// Some lenslets and their windows.
struct Group {
  std::size_t n = 0;  ///< lenslets; the lanes after them repeat the first
  std::array<std::size_t, kMaxLanes> lenslet{};
  std::size_t w = 0;  ///< of the widest window
  std::size_t h = 0;
  // Of each: where its window's centre lies from its first pixel, the window's size, the reference
  // from the centre, the threshold's centroid from the centre (the reference where it has none).
  alignas(64) Row half_x{}, half_y{}, width{}, height{}, reference_x{},
      reference_y{}, start_x{}, start_y{};
};

constexpr float kSqrtTwoPi = 2.5066283F;

/// The method sees no light here, whatever the threshold let pass.
void clear_spot(Centroids& out, std::size_t k, LensletState state) noexcept {
  out.x_px[k] = out.y_px[k] = out.flux_adu[k] = 0.0F;
  out.xx_px2[k] = out.yy_px2[k] = out.xy_px2[k] = 0.0F;
  out.variance_x_px2[k] = out.variance_y_px2[k] = out.covariance_xy_px2[k] = 0.0F;
  out.state[k] = state;
}

/// Puts one lenslet's position in the place of the threshold's.
void adopt(const CentroidPlan& plan, const Found& found, std::size_t lane, std::size_t k,
           Centroids& out) noexcept {
  const CentroidPlan::Spot& spot = plan.spots[k];
  const bool was_valid = out.state[k] == LensletState::kValid;
  const float x = found.x[lane];
  const float y = found.y[lane];
  const float signal = found.signal[lane];
  LensletState state = LensletState::kValid;
  if (!(signal > 0.0F && signal * signal >= plan.min_snr_squared * found.signal_variance[lane])) {
    state = LensletState::kFaint;
  } else if (!(x >= spot.min_x && x <= spot.max_x && y >= spot.min_y && y <= spot.max_y)) {
    state = LensletState::kAtEdge;
  }
  out.n_valid += (state == LensletState::kValid ? 1 : 0) - (was_valid ? 1 : 0);
  if (!(signal > 0.0F)) return clear_spot(out, k, state);
  if (!(out.flux_adu[k] > 0.0F)) out.flux_adu[k] = found.flux[lane] * plan.adu_per_count;
  if (!was_valid) {
    out.xx_px2[k] = out.yy_px2[k] = plan.spot_sigma_px * plan.spot_sigma_px;
    out.xy_px2[k] = 0.0F;
  }
  out.x_px[k] = (static_cast<float>(spot.x0) + 0.5F * static_cast<float>(spot.w - 1)) + x;
  out.y_px[k] = (static_cast<float>(spot.y0) + 0.5F * static_cast<float>(spot.h - 1)) + y;
  const bool known = plan.counts_per_e > 0.0F;
  out.variance_x_px2[k] = known ? found.variance_x[lane] : 0.0F;
  out.variance_y_px2[k] = known ? found.variance_y[lane] : 0.0F;
  out.covariance_xy_px2[k] = known ? found.covariance[lane] : 0.0F;
  out.state[k] = state;
}

void describe(const CentroidPlan& plan, const Centroids& out, Group& group,
              std::size_t lanes) noexcept {
  group.w = group.h = 0;
  for (std::size_t lane = 0; lane < lanes; ++lane) {
    const std::size_t k = group.lenslet[lane < group.n ? lane : 0];
    const CentroidPlan::Spot& spot = plan.spots[k];
    group.lenslet[lane] = k;
    group.w = std::max(group.w, static_cast<std::size_t>(spot.w));
    group.h = std::max(group.h, static_cast<std::size_t>(spot.h));
    group.width[lane] = static_cast<float>(spot.w);
    group.height[lane] = static_cast<float>(spot.h);
    group.half_x[lane] = 0.5F * (group.width[lane] - 1.0F);
    group.half_y[lane] = 0.5F * (group.height[lane] - 1.0F);
    group.reference_x[lane] = plan.reference_x[k];
    group.reference_y[lane] = plan.reference_y[k];
    const bool known = out.state[k] == LensletState::kValid;
    group.start_x[lane] = known ? out.x_px[k] - (static_cast<float>(spot.x0) + group.half_x[lane])
                                : group.reference_x[lane];
    group.start_y[lane] = known ? out.y_px[k] - (static_cast<float>(spot.y0) + group.half_y[lane])
                                : group.reference_y[lane];
  }
}

/// light: [h, w, lanes], counts above the dark.
template <typename Pixel, bool kMaps>
void load_windows(const CentroidPlan& plan, const Pixel* pixels, const Group& group,
                  std::size_t lanes, float* light) noexcept {
  const float bad = plan.method == CentroidMethod::kMaximumLikelihood ? kBad : kNothing;
  const float offset = plan.uniform_offset - plan.threshold;
  for (std::size_t lane = 0; lane < lanes; ++lane) {
    const CentroidPlan::Spot& spot = plan.spots[group.lenslet[lane]];
    const auto w = static_cast<std::size_t>(spot.w);
    const auto h = static_cast<std::size_t>(spot.h);
    for (std::size_t y = 0; y < group.h; ++y) {
      float* to = light + y * group.w * lanes + lane;
      std::size_t x = 0;
      if (y < h) {
        const Pixel* from =
            pixels +
            (static_cast<std::size_t>(spot.y0) + y) * static_cast<std::size_t>(plan.frame_cols) +
            static_cast<std::size_t>(spot.x0);
        for (; x < w; ++x) {
          const auto count = static_cast<float>(from[x]);
          if constexpr (kMaps) {
            const float gain = plan.gain[spot.map + y * w + x];
            const float dark = plan.offset[spot.map + y * w + x] - plan.threshold;
            to[x * lanes] = gain > 0.0F ? gain * count - dark : bad;
          } else {
            to[x * lanes] = count - offset;
          }
        }
      }
      for (; x < group.w; ++x) to[x * lanes] = bad;
    }
  }
}

}  // namespace
}  // namespace curlew
#endif  // CURLEW_CENTROID_METHODS_ONCE

HWY_BEFORE_NAMESPACE();
namespace curlew::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::CappedTag<float, kMaxLanes>;
using V = hn::Vec<D>;
using M = hn::Mask<D>;
constexpr D d;

V set(float value) { return hn::Set(d, value); }
V load(const Row& row) { return hn::LoadU(d, row.data()); }
void store(V value, Row& row) { hn::StoreU(value, d, row.data()); }
std::size_t lane_count() { return hn::Lanes(d); }

/// The pixels of a group and their noise.
struct Windows {
  const Group& group;
  const float* light;
  std::size_t w, h;
  V per_count;  ///< variance of a pixel: per_count·I + constant, counts²
  V constant;

  V at(std::size_t y, std::size_t x) const {
    return hn::LoadU(d, light + (y * w + x) * lane_count());
  }
};

/// A Gaussian of height 1 about a position, at the pixels of one axis: g, g·u and g·u², u from the
/// position. 0 beyond the window.
struct Axis {
  V g[kMaxSide];
  V gu[kMaxSide];
  V guu[kMaxSide];

  void place(std::size_t n, V length, V half, V position, V inverse_2s2) {
    V u = hn::Neg(hn::Add(half, position));
    V pixel = hn::Zero(d);
    for (std::size_t i = 0; i < n; ++i) {
      const V e = hn::Exp(d, hn::Neg(hn::Mul(hn::Mul(u, u), inverse_2s2)));
      g[i] = hn::IfThenElseZero(hn::Lt(pixel, length), e);
      gu[i] = hn::Mul(g[i], u);
      guu[i] = hn::Mul(gu[i], u);
      u = hn::Add(u, set(1.0F));
      pixel = hn::Add(pixel, set(1.0F));
    }
  }
};

V clamped(V value, V limit) { return hn::Max(hn::Min(value, limit), hn::Neg(limit)); }

/// x / y, and 0 where y is not positive.
V ratio(V x, V y) {
  const M ok = hn::Gt(y, hn::Zero(d));
  return hn::IfThenElseZero(ok, hn::Div(x, hn::IfThenElse(ok, y, set(1.0F))));
}

/// See find_positions(). `pull` in counts.
void find_weighted(const CentroidPlan& plan, const Windows& windows, float pull, Found& found) {
  const Group& group = windows.group;
  const float s2 = plan.spot_sigma_px * plan.spot_sigma_px;
  const V inverse_2s2 = set(0.5F / s2);
  const V width = load(group.width), height = load(group.height);
  const V half_x = load(group.half_x), half_y = load(group.half_y);
  const V reference_x = load(group.reference_x), reference_y = load(group.reference_y);
  const V most_x = hn::Mul(width, set(0.5F)), most_y = hn::Mul(height, set(0.5F));
  const V c = set(pull);
  V x = hn::Mul(hn::Add(reference_x, load(group.start_x)), set(0.5F));
  V y = hn::Mul(hn::Add(reference_y, load(group.start_y)), set(0.5F));
  Axis ax, ay;
  for (int step = 0; step < kWeightedSteps; ++step) {
    ax.place(windows.w, width, half_x, x, inverse_2s2);
    ay.place(windows.h, height, half_y, y, inverse_2s2);
    V sum = hn::Zero(d), sum_x = sum, sum_y = sum;
    for (std::size_t i = 0; i < windows.h; ++i) {
      V row = hn::Zero(d), row_x = row;
      for (std::size_t j = 0; j < windows.w; ++j) {
        const V light = windows.at(i, j);
        row = hn::MulAdd(light, ax.g[j], row);
        row_x = hn::MulAdd(light, ax.gu[j], row_x);
      }
      sum = hn::MulAdd(row, ay.g[i], sum);
      sum_x = hn::MulAdd(row_x, ay.g[i], sum_x);
      sum_y = hn::MulAdd(row, ay.gu[i], sum_y);
    }
    const V all = hn::Add(hn::Max(sum, hn::Zero(d)), c);
    x = hn::Add(x, ratio(hn::NegMulAdd(c, hn::Sub(x, reference_x), sum_x), all));
    y = hn::Add(y, ratio(hn::NegMulAdd(c, hn::Sub(y, reference_y), sum_y), all));
    x = clamped(x, most_x);
    y = clamped(y, most_y);
  }
  store(x, found.x);
  store(y, found.y);

  // Noise. One step moves x by dI·g·u/(S + c); what a step had moved, the next keeps by
  // r = Σ I·g·u²/s²/(S + c), the spot's width under the weight: 1 + r + r² of it are left.
  V sum = hn::Zero(d), sum_xx = sum, sum_yy = sum;
  V q = sum, q_xx = sum, q_yy = sum, q_xy = sum;  // Σ Var(I)·g²·…
  for (std::size_t i = 0; i < windows.h; ++i) {
    V row = hn::Zero(d), row_xx = row, row_q = row, row_qx = row, row_qxx = row;
    for (std::size_t j = 0; j < windows.w; ++j) {
      const V light = windows.at(i, j);
      const V variance = hn::MulAdd(light, windows.per_count, windows.constant);
      row = hn::MulAdd(light, ax.g[j], row);
      row_xx = hn::MulAdd(light, ax.guu[j], row_xx);
      row_q = hn::MulAdd(hn::Mul(variance, ax.g[j]), ax.g[j], row_q);
      row_qx = hn::MulAdd(hn::Mul(variance, ax.g[j]), ax.gu[j], row_qx);
      row_qxx = hn::MulAdd(hn::Mul(variance, ax.gu[j]), ax.gu[j], row_qxx);
    }
    sum = hn::MulAdd(row, ay.g[i], sum);
    sum_xx = hn::MulAdd(row_xx, ay.g[i], sum_xx);
    sum_yy = hn::MulAdd(row, ay.guu[i], sum_yy);
    const V g2 = hn::Mul(ay.g[i], ay.g[i]);
    q = hn::MulAdd(row_q, g2, q);
    q_xx = hn::MulAdd(row_qxx, g2, q_xx);
    q_xy = hn::MulAdd(row_qx, hn::Mul(ay.g[i], ay.gu[i]), q_xy);
    q_yy = hn::MulAdd(row_q, hn::Mul(ay.gu[i], ay.gu[i]), q_yy);
  }
  const V all = hn::Add(hn::Max(sum, hn::Zero(d)), c);
  const auto response = [&](V moment) {
    const V r = hn::Max(ratio(hn::Mul(moment, set(1.0F / s2)), all), hn::Zero(d));
    return ratio(hn::MulAdd(hn::Add(r, set(1.0F)), r, set(1.0F)), all);
  };
  const V rx = response(sum_xx), ry = response(sum_yy);
  // Widened, so that D beyond 2.8 to 3.8 σ is about as frequent as for a Gaussian (Monte Carlo on
  // sinc² spots of 200 and 1000 photons): by 11/F as the variance scatters with the photons that it
  // is taken from, see kWidening in centroid.cpp, and by what the spot's rings add, 5.5 %.
  const V flux = hn::Add(sum, sum);
  const V widened = hn::Add(set(1.055F), ratio(hn::Mul(set(11.0F), windows.per_count), flux));
  // Never below what the read noise alone comes to: Σ k·I may be negative.
  const V least = hn::Mul(windows.constant, set(0.39F * s2 * s2));  // half of σ²·π·s⁴/4
  const V wx = hn::Mul(rx, widened);
  store(hn::Mul(hn::Mul(rx, wx), hn::Max(q_xx, least)), found.variance_x);
  store(hn::Mul(hn::Mul(ry, hn::Mul(ry, widened)), hn::Max(q_yy, least)), found.variance_y);
  store(hn::Mul(hn::Mul(wx, ry), q_xy), found.covariance);
  store(sum, found.signal);
  store(hn::Max(q, hn::Zero(d)), found.signal_variance);
  store(hn::Add(sum, sum), found.flux);  // Σ of g times a spot as wide as g: half of the spot
}

/// `smooth`: [h, w, lanes], and `rows` as much, for passing use.
void find_correlation(const CentroidPlan& plan, const Windows& windows, float* smooth, float* rows,
                      Found& found) {
  const Group& group = windows.group;
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
      hn::StoreU(sum, d, rows + (i * windows.w + j) * lanes);
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
        sum = hn::MulAdd(hn::LoadU(d, rows + (t * windows.w + j) * lanes),
                         set(g[t > i ? t - i : i - t]), sum);
      }
      hn::StoreU(sum, d, smooth + (i * windows.w + j) * lanes);
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

void find_brightest(const CentroidPlan& plan, const Windows& windows, Found& found) {
  const auto n = static_cast<std::size_t>(plan.brightest_pixels);
  V brightest[kMaxBrightestPixels + 1];  // by falling brightness
  for (std::size_t m = 0; m <= n; ++m) brightest[m] = hn::Zero(d);
  for (std::size_t i = 0; i < windows.h; ++i) {
    for (std::size_t j = 0; j < windows.w; ++j) {
      V value = windows.at(i, j);
      for (std::size_t m = 0; m <= n; ++m) {
        const V larger = hn::Max(brightest[m], value);
        value = hn::Min(brightest[m], value);
        brightest[m] = larger;
      }
    }
  }
  const V threshold = brightest[n];
  const V first_x = hn::Neg(load(windows.group.half_x));
  const V first_y = hn::Neg(load(windows.group.half_y));
  V sum = hn::Zero(d), sum_x = sum, sum_y = sum;
  V u_y = first_y;
  for (std::size_t i = 0; i < windows.h; ++i) {
    V row = hn::Zero(d), row_x = row, u_x = first_x;
    for (std::size_t j = 0; j < windows.w; ++j) {
      const V v = hn::Max(hn::Sub(windows.at(i, j), threshold), hn::Zero(d));
      row = hn::Add(row, v);
      row_x = hn::MulAdd(v, u_x, row_x);
      u_x = hn::Add(u_x, set(1.0F));
    }
    sum = hn::Add(sum, row);
    sum_x = hn::Add(sum_x, row_x);
    sum_y = hn::MulAdd(row, u_y, sum_y);
    u_y = hn::Add(u_y, set(1.0F));
  }
  const V x = ratio(sum_x, sum);
  const V y = ratio(sum_y, sum);
  // As of any threshold's, variance_of_signal() in centroid.cpp: a pixel near T is cut off by it.
  const V constant = hn::MulAdd(threshold, windows.per_count, windows.constant);
  const V ramp = ratio(set(1.0F), hn::MulAdd(set(0.85F), hn::Sqrt(constant), windows.per_count));
  V q = hn::Zero(d), q_xx = q, q_yy = q, q_xy = q;
  u_y = hn::Sub(first_y, y);
  for (std::size_t i = 0; i < windows.h; ++i) {
    V u_x = hn::Sub(first_x, x);
    for (std::size_t j = 0; j < windows.w; ++j) {
      const V v = hn::Max(hn::Sub(windows.at(i, j), threshold), hn::Zero(d));
      const V variance =
          hn::Mul(hn::MulAdd(v, windows.per_count, constant), hn::Min(hn::Mul(v, ramp), set(1.0F)));
      const V v_x = hn::Mul(variance, u_x);
      q = hn::Add(q, variance);
      q_xx = hn::MulAdd(v_x, u_x, q_xx);
      q_xy = hn::MulAdd(v_x, u_y, q_xy);
      q_yy = hn::MulAdd(hn::Mul(variance, u_y), u_y, q_yy);
      u_x = hn::Add(u_x, set(1.0F));
    }
    u_y = hn::Add(u_y, set(1.0F));
  }
  store(x, found.x);
  store(y, found.y);
  store(ratio(ratio(q_xx, sum), sum), found.variance_x);
  store(ratio(ratio(q_yy, sum), sum), found.variance_y);
  store(ratio(ratio(q_xy, sum), sum), found.covariance);
  store(sum, found.signal);
  store(q, found.signal_variance);
  store(sum, found.flux);
}

/// Lower Cholesky factor, in place, of a symmetric 4×4 matrix a lane; where a pivot is not positive
/// ok is cleared and the factor means nothing.
void factor(V (&a)[4][4], M& ok) {
  for (int j = 0; j < 4; ++j) {
    V pivot = a[j][j];
    for (int m = 0; m < j; ++m) pivot = hn::NegMulAdd(a[j][m], a[j][m], pivot);
    ok = hn::And(ok, hn::Gt(pivot, hn::Zero(d)));
    const V root = hn::Sqrt(hn::IfThenElse(ok, pivot, set(1.0F)));
    const V inverse = hn::Div(set(1.0F), root);
    a[j][j] = root;
    for (int i = j + 1; i < 4; ++i) {
      V value = a[i][j];
      for (int m = 0; m < j; ++m) value = hn::NegMulAdd(a[i][m], a[j][m], value);
      a[i][j] = hn::Mul(value, inverse);
    }
  }
}

/// windows hold kBad where a pixel does not count; `clean`: [h, w, lanes], for passing use.
void find_most_likely(const CentroidPlan& plan, const Windows& windows, float* clean,
                      Found& found) {
  for (std::size_t i = 0; i < windows.h * windows.w * lane_count(); ++i)
    clean[i] = windows.light[i] > 0.5F * kBad ? windows.light[i] : kNothing;
  Windows start = windows;
  start.light = clean;
  find_weighted(plan, start, 0.0F, found);
  const Group& group = windows.group;
  const float s = plan.spot_sigma_px;
  const V inverse_2s2 = set(0.5F / (s * s));
  const V width = load(group.width), height = load(group.height);
  const V half_x = load(group.half_x), half_y = load(group.half_y);
  const V most_x = hn::Mul(width, set(0.5F)), most_y = hn::Mul(height, set(0.5F));
  V x = load(found.x), y = load(found.y);
  // Amplitude, so that g has height 1. Peaks from Σ I·g, which is half of 2π·s² of them.
  V amplitude = hn::Max(hn::Mul(load(found.signal), set(2.0F / (kSqrtTwoPi * kSqrtTwoPi * s * s))),
                        hn::Zero(d));
  V background = hn::Zero(d);
  // Every pixel the same variance where none is known.
  const V constant = plan.pixel_variance > 0.0F ? windows.constant : set(1.0F);
  Axis ax, ay;
  V a[4][4];
  M ok = hn::Gt(amplitude, hn::Zero(d));
  V information = hn::Zero(d);
  for (int step = 0; step <= kLikelihoodSteps; ++step) {
    ax.place(windows.w, width, half_x, x, inverse_2s2);
    ay.place(windows.h, height, half_y, y, inverse_2s2);
    V b[4];
    for (int m = 0; m < 4; ++m) {
      b[m] = hn::Zero(d);
      for (int l = 0; l <= m; ++l) a[m][l] = hn::Zero(d);
    }
    const V per_px = hn::Mul(amplitude, hn::Add(inverse_2s2, inverse_2s2));  // F/s²
    for (std::size_t i = 0; i < windows.h; ++i) {
      for (std::size_t j = 0; j < windows.w; ++j) {
        const V light = windows.at(i, j);
        const V g = hn::Mul(ax.g[j], ay.g[i]);
        const V mean = hn::MulAdd(amplitude, g, background);
        const V variance = hn::MulAdd(hn::Max(mean, hn::Zero(d)), windows.per_count, constant);
        const V weight =
            hn::IfThenElseZero(hn::Gt(light, set(0.5F * kBad)), hn::Div(set(1.0F), variance));
        const V residual = hn::Sub(light, mean);
        const V slope[4] = {g, set(1.0F), hn::Mul(per_px, hn::Mul(ax.gu[j], ay.g[i])),
                            hn::Mul(per_px, hn::Mul(ax.g[j], ay.gu[i]))};
        for (int m = 0; m < 4; ++m) {
          const V weighted = hn::Mul(weight, slope[m]);
          b[m] = hn::MulAdd(weighted, residual, b[m]);
          for (int l = 0; l <= m; ++l) a[m][l] = hn::MulAdd(weighted, slope[l], a[m][l]);
        }
      }
    }
    information = a[0][0];
    for (int m = 0; m < 4; ++m) a[m][m] = hn::Mul(a[m][m], set(1.0F + 1e-5F));
    factor(a, ok);
    if (step == kLikelihoodSteps) break;
    for (int m = 0; m < 4; ++m) {
      for (int l = 0; l < m; ++l) b[m] = hn::NegMulAdd(a[m][l], b[l], b[m]);
      b[m] = hn::Div(b[m], a[m][m]);
    }
    for (int m = 3; m >= 0; --m) {
      for (int l = m + 1; l < 4; ++l) b[m] = hn::NegMulAdd(a[l][m], b[l], b[m]);
      b[m] = hn::Div(b[m], a[m][m]);
    }
    const auto allowed = [&](V change) { return hn::IfThenElseZero(ok, change); };
    constexpr float kLeastLeft = 0.2F;  // of the amplitude
    amplitude = hn::Max(hn::Add(amplitude, allowed(b[0])), hn::Mul(amplitude, set(kLeastLeft)));
    background = hn::Add(background, allowed(b[1]));
    x = clamped(hn::Add(x, clamped(allowed(b[2]), set(s))), most_x);
    y = clamped(hn::Add(y, clamped(allowed(b[3]), set(s))), most_y);
  }
  // The last block of the inverse is that of L⁻ᵀ·L⁻¹.
  const V inverse_xx = hn::Div(set(1.0F), a[2][2]);
  const V inverse_yy = hn::Div(set(1.0F), a[3][3]);
  const V mixed = hn::Neg(hn::Mul(hn::Mul(a[3][2], inverse_xx), inverse_yy));
  store(x, found.x);
  store(y, found.y);
  store(hn::MulAdd(mixed, mixed, hn::Mul(inverse_xx, inverse_xx)), found.variance_x);
  store(hn::Mul(inverse_yy, inverse_yy), found.variance_y);
  store(hn::Mul(mixed, inverse_yy), found.covariance);
  store(hn::IfThenElseZero(ok, amplitude), found.signal);
  store(ratio(set(plan.pixel_variance > 0.0F ? 1.0F : 0.0F), information), found.signal_variance);
  store(hn::Mul(amplitude, set(kSqrtTwoPi * kSqrtTwoPi * s * s)), found.flux);
}

/// As many vectors as the widest windows have pixels.
using Buffer = std::array<float, kMaxSide * kMaxSide * kMaxLanes>;

template <typename Pixel, bool kMaps>
void find_rows(const CentroidPlan& plan, FrameView frame, int first, int last, Centroids& out) {
  alignas(64) Buffer light;  // not cleared: only what is loaded is read
  alignas(64) Found found;
  const auto* pixels = frame.data<Pixel>();
  const std::size_t lanes = lane_count();
  Group group;
  const auto measure = [&] {
    describe(plan, out, group, lanes);
    load_windows<Pixel, kMaps>(plan, pixels, group, lanes, light.data());
    const Windows windows{group,   light.data(),           group.w,
                          group.h, set(plan.counts_per_e), set(plan.pixel_variance)};
    switch (plan.method) {
      case CentroidMethod::kCorrelation: {
        alignas(64) Buffer smooth;
        alignas(64) Buffer rows;
        find_correlation(plan, windows, smooth.data(), rows.data(), found);
        break;
      }
      case CentroidMethod::kBrightestPixels:
        find_brightest(plan, windows, found);
        break;
      case CentroidMethod::kMaximumLikelihood: {
        alignas(64) Buffer clean;
        find_most_likely(plan, windows, clean.data(), found);
        break;
      }
      default:
        find_weighted(plan, windows, plan.reference_pull, found);
    }
    for (std::size_t lane = 0; lane < group.n; ++lane)
      adopt(plan, found, lane, group.lenslet[lane], out);
    group.n = 0;
  };
  const auto cols = static_cast<std::size_t>(plan.spots.cols());
  for (std::size_t k = static_cast<std::size_t>(first) * cols;
       k < static_cast<std::size_t>(last) * cols; ++k) {
    if (out.state[k] != LensletState::kValid && out.state[k] != LensletState::kFaint) continue;
    group.lenslet[group.n++] = k;
    if (group.n == lanes) measure();
  }
  if (group.n > 0) measure();
}

void find(const CentroidPlan& plan, FrameView frame, int first, int last, Centroids& out) {
  const bool maps = !plan.gain.empty();
  if (frame.pixel_type == PixelType::kU16) {
    maps ? find_rows<std::uint16_t, true>(plan, frame, first, last, out)
         : find_rows<std::uint16_t, false>(plan, frame, first, last, out);
  } else {
    maps ? find_rows<std::uint8_t, true>(plan, frame, first, last, out)
         : find_rows<std::uint8_t, false>(plan, frame, first, last, out);
  }
}

}  // namespace
}  // namespace curlew::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace curlew {

HWY_EXPORT(find);

void find_positions(const CentroidPlan& plan, FrameView frame, int first, int last,
                    Centroids& centroids) noexcept {
  HWY_DYNAMIC_DISPATCH(find)(plan, frame, first, last, centroids);
}

}  // namespace curlew
#endif  // HWY_ONCE
