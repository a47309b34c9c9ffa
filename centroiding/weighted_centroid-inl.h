// This file finds positions by kWeighted, which centroid_methods.h describes.
//
// Highway compiles it anew for every instruction set, which is why the include guard toggles.
#if defined(CURLEW_WEIGHTED_CENTROID_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef CURLEW_WEIGHTED_CENTROID_INL_H_
#undef CURLEW_WEIGHTED_CENTROID_INL_H_
#else
#define CURLEW_WEIGHTED_CENTROID_INL_H_
#endif

#include <cstddef>

#include "centroiding/window_lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace curlew::HWY_NAMESPACE {

inline constexpr int kWeightedSteps = 3;

/// Finds the positions of a group's spots by kWeighted. `pull` is in counts.
inline void find_weighted(const CentroidPlan& plan, const Windows& windows, float pull,
                          GroupPositions& found) {
  const WindowGroup& group = windows.group;
  const float s2 = plan.spot_sigma_px * plan.spot_sigma_px;
  const V inverse_2s2 = set(0.5F / s2);
  const V width = load(group.width), height = load(group.height);
  const V half_x = load(group.half_x), half_y = load(group.half_y);
  const V reference_x = load(group.reference_x), reference_y = load(group.reference_y);
  const V max_x = hn::Mul(width, set(0.5F)), max_y = hn::Mul(height, set(0.5F));
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
    x = clamped(x, max_x);
    y = clamped(y, max_y);
  }
  store(x, found.x);
  store(y, found.y);

  // The noise follows from how light moves the position. In one step, a change dI of a pixel's
  // light moves x by dI·g·u/(S + c) with S = Σ I·g. Each further step keeps the fraction r = Σ
  // I·g·u²/s²/(S + c) of the move, which is the spot's width under the weight. After three steps
  // the move is 1 + r + r² times that of one.
  V sum = hn::Zero(d), sum_xx = sum, sum_yy = sum;
  V q = sum, q_xx = sum, q_yy = sum, q_xy = sum;  // sums of the kind Σ Var(I)·g²·…
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
  // The variance is widened, so that D beyond 2.8 to 3.8 σ is about as frequent as for a Gaussian
  // (Monte Carlo on sinc² spots of 200 and 1000 photons). It is widened by 11/F because the
  // variance scatters with the photons that it is estimated from, see kPhotonWidening, and by 5.5 %
  // for the light in the spot's rings.
  const V flux = hn::Add(sum, sum);
  const V widened = hn::Add(set(1.055F), ratio(hn::Mul(set(11.0F), windows.per_count), flux));
  // The sums over all pixels may be negative, because Σ k·I may be. Read noise alone makes them
  // σ²·π·s⁴/2, and at least a quarter of this is kept.
  const V minimum = hn::Mul(windows.constant, set(0.39F * s2 * s2));
  const V wx = hn::Mul(rx, widened);
  store(hn::Mul(hn::Mul(rx, wx), hn::Max(q_xx, minimum)), found.variance_x);
  store(hn::Mul(hn::Mul(ry, hn::Mul(ry, widened)), hn::Max(q_yy, minimum)), found.variance_y);
  store(hn::Mul(hn::Mul(wx, ry), q_xy), found.covariance);
  store(sum, found.signal);
  store(hn::Max(q, hn::Zero(d)), found.signal_variance);
  // The sum of g times a spot as wide as g is half of the spot's light.
  store(hn::Add(sum, sum), found.flux);
}

}  // namespace curlew::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // per target
