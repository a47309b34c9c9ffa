// This file finds positions by kBrightestPixels, which centroid_methods.h describes.
//
// Highway compiles it anew for every instruction set, which is why the include guard toggles.
#if defined(CURLEW_BRIGHTEST_CENTROID_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef CURLEW_BRIGHTEST_CENTROID_INL_H_
#undef CURLEW_BRIGHTEST_CENTROID_INL_H_
#else
#define CURLEW_BRIGHTEST_CENTROID_INL_H_
#endif

#include <cstddef>

#include "centroiding/window_lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace curlew::HWY_NAMESPACE {

/// Returns each lenslet's (n + 1)-th brightest pixel.
inline V next_to_brightest(const Windows& windows, std::size_t n) {
  // These are each lenslet's n + 1 brightest pixels, the brightest first.
  V brightest[kMaxBrightestPixels + 1];
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
  return brightest[n];
}

inline void find_brightest(const CentroidPlan& plan, const Windows& windows,
                           GroupPositions& found) {
  const V threshold = next_to_brightest(windows, static_cast<std::size_t>(plan.brightest_pixels));
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
  // The variance of a pixel is less near T, where the threshold clips it; see SignalVariance. Here
  // a ramp says so, not its square.
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

}  // namespace curlew::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // per target
