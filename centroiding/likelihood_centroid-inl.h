// This file finds positions by kMaximumLikelihood, which centroid_methods.h describes.
//
// Highway compiles it anew for every instruction set, which is why the include guard toggles.
#if defined(CURLEW_LIKELIHOOD_CENTROID_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef CURLEW_LIKELIHOOD_CENTROID_INL_H_
#undef CURLEW_LIKELIHOOD_CENTROID_INL_H_
#else
#define CURLEW_LIKELIHOOD_CENTROID_INL_H_
#endif

#include <cstddef>

#include "centroiding/weighted_centroid-inl.h"
#include "centroiding/window_lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace curlew::HWY_NAMESPACE {

inline constexpr int kLikelihoodSteps = 6;
inline constexpr float kSqrtTwoPi = 2.5066283F;

/// Replaces the symmetric 4×4 matrix of each lane by its lower Cholesky factor. Where a pivot is
/// not positive, `ok` is cleared and the factor means nothing.
inline void factor(V (&a)[4][4], M& ok) {
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

/// Finds the positions of a group's spots by kMaximumLikelihood. The windows hold kBad where a
/// pixel does not count.
inline void find_most_likely(const CentroidPlan& plan, const Windows& windows,
                             GroupPositions& found) {
  alignas(64) WindowBuffer clean;  // It is not cleared, for only what is written is read.
  for (std::size_t i = 0; i < windows.h * windows.w * lane_count(); ++i)
    clean[i] = windows.light[i] > 0.5F * kBad ? windows.light[i] : kNothing;
  Windows start = windows;
  start.light = clean.data();
  find_weighted(plan, start, 0.0F, found);
  const WindowGroup& group = windows.group;
  const float s = plan.spot_sigma_px;
  const V inverse_2s2 = set(0.5F / (s * s));
  const V width = load(group.width), height = load(group.height);
  const V half_x = load(group.half_x), half_y = load(group.half_y);
  const V max_x = hn::Mul(width, set(0.5F)), max_y = hn::Mul(height, set(0.5F));
  V x = load(found.x), y = load(found.y);
  // The amplitude is the height of the fitted Gaussian, because g has height 1. It begins with what
  // Σ I·g says: this sum is half of the flux, and the flux is 2π·s² times the height.
  V amplitude = hn::Max(hn::Mul(load(found.signal), set(2.0F / (kSqrtTwoPi * kSqrtTwoPi * s * s))),
                        hn::Zero(d));
  V background = hn::Zero(d);
  // Every pixel has the same variance where the noise is not known.
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
    // A step leaves at least this fraction of the amplitude.
    constexpr float kMinLeft = 0.2F;
    amplitude = hn::Max(hn::Add(amplitude, allowed(b[0])), hn::Mul(amplitude, set(kMinLeft)));
    background = hn::Add(background, allowed(b[1]));
    x = clamped(hn::Add(x, clamped(allowed(b[2]), set(s))), max_x);
    y = clamped(hn::Add(y, clamped(allowed(b[3]), set(s))), max_y);
  }
  // The last 2×2 block of the inverse of L·Lᵀ is that of L⁻ᵀ·L⁻¹.
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

}  // namespace curlew::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // per target
