// This file turns the moments of windows into centroids, noise and states, a vector of lenslets at
// a time.
//
// Highway compiles it anew for every instruction set, which is why the include guard toggles.
#ifndef CURLEW_SPOT_FINISH_ONCE
#define CURLEW_SPOT_FINISH_ONCE

namespace curlew {

/// A variance that is estimated from the very photons it describes scatters, so that D/σ has
/// Student's longer tails. And those of spots that hardly stand out of their noise are longer
/// still: with ε, the relative variance of a spot's light, D has an excess kurtosis of some 35 ε².
/// The variance is therefore widened by 12·p⁴/F + min(500·ε³, .45), where F is the light above the
/// threshold in electrons and p the part of its variance that is the photons'. It is fitted to
/// spots of 2 px a λ/w: there |D| is beyond 3 σ as often as for a Gaussian within 20 %
/// with 60 to 5000 photons and a read noise of .5 to 9 e⁻, beyond 3.6 σ within 30 %, and beyond
/// 4.2 σ within 35 % from 100 photons up (Monte Carlo; with 50 photons and 1 e⁻ .8, 1.5 and 4.5
/// times). Spots of 3 px a λ/w in windows of 8 px, which have more pixels near the threshold, are
/// beyond 3 σ up to 1.8 times as often.
inline constexpr float kPhotonWidening = 12.0F;
inline constexpr float kFaintWidening = 500.0F;
inline constexpr float kMostFaint = 0.45F;  // More would silence the weak spots in vortices.

}  // namespace curlew
#endif  // CURLEW_SPOT_FINISH_ONCE

#if defined(CURLEW_SPOT_FINISH_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef CURLEW_SPOT_FINISH_INL_H_
#undef CURLEW_SPOT_FINISH_INL_H_
#else
#define CURLEW_SPOT_FINISH_INL_H_
#endif

#include <cstddef>
#include <cstdint>

#include "centroiding/centroid.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace curlew::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// These are moments of windows about their centres. Each lane is one lenslet.
template <class D>
struct Moments {
  hn::Vec<D> s, x, y, xx, xy, yy;
};

/// Where the windows are, and what is known of them before any frame; see WindowSpot.
template <class D>
struct SpotPlaces {
  hn::Vec<D> centre_x, centre_y, min_x, max_x, min_y, max_y;
  hn::Vec<hn::RebindToSigned<D>> state;
};

/// Stores the first n lanes.
template <class D, typename T = hn::TFromD<D>>
void store_first(D d, hn::Vec<D> values, std::size_t n, T* to) {
  if (n == hn::Lanes(d)) {
    hn::StoreU(values, d, to);
    return;
  }
  HWY_ALIGN T all[hn::MaxLanes(D())];
  hn::Store(values, d, all);
  for (std::size_t i = 0; i < n; ++i) to[i] = all[i];
}

/// Writes centroids, noise and states of the lenslets k to k + n − 1, of which there is one in each
/// lane. v are the moments of the signals, r those of the remainders of their variances; see
/// SignalVariance.
template <class D, class V = hn::Vec<D>>
void finish_spots(D d, const CentroidPlan& plan, const SpotPlaces<D>& places, const Moments<D>& v,
                  const Moments<D>& r, V peak, std::size_t k, std::size_t n, Centroids& out) {
  const hn::RebindToSigned<D> di;
  const auto named = [&](LensletState state) {
    return hn::Set(di, static_cast<std::int32_t>(state));
  };
  const V zero = hn::Zero(d);
  const V one = hn::Set(d, 1.0F);
  const V per_count = hn::Set(d, plan.counts_per_e);
  const auto variance = [&](V signals, V remainders) {
    return hn::MulAdd(signals, per_count, remainders);
  };
  // The moments of the variances, less the window's mean gain.
  const Moments<D> q{variance(v.s, r.s),   variance(v.x, r.x),   variance(v.y, r.y),
                     variance(v.xx, r.xx), variance(v.xy, r.xy), variance(v.yy, r.yy)};
  const V gain = hn::LoadU(d, &plan.mean_gain[k]);
  const auto lit = hn::Gt(v.s, zero);
  const auto good = hn::RebindMask(d, hn::Eq(places.state, named(LensletState::kValid)));
  const auto saturated = hn::And(good, hn::Ge(peak, hn::Set(d, plan.saturation)));
  const V inverse = hn::Div(one, hn::IfThenElse(lit, v.s, one));
  const V photons_part =
      hn::IfThenElseZero(hn::Gt(q.s, zero), hn::Div(hn::Mul(v.s, per_count), q.s));
  const V photons = hn::Mul(hn::Set(d, kPhotonWidening * plan.counts_per_e), inverse);
  const V part2 = hn::Mul(photons_part, photons_part);
  const V unwidened = hn::Mul(gain, hn::Mul(inverse, inverse));
  const V e = hn::Mul(q.s, unwidened);
  const V faint = hn::Min(hn::Mul(hn::Mul(hn::Set(d, kFaintWidening), e), hn::Mul(e, e)),
                          hn::Set(d, kMostFaint));
  const V widening = hn::MulAdd(hn::Mul(photons, part2), part2, hn::Add(faint, one));
  const V scale = hn::Mul(widening, unwidened);
  // Counts that are no light, as of a damaged map, must not spread.
  const auto total = [](const Moments<D>& of) {
    return hn::Add(hn::Add(hn::Add(of.s, of.x), hn::Add(of.y, of.xx)), hn::Add(of.xy, of.yy));
  };
  const auto finite = hn::IsFinite(hn::MulAdd(total(q), scale, hn::MulAdd(total(v), inverse, v.s)));
  const auto unusable = hn::AndNot(finite, good);
  const auto measured = hn::AndNot(hn::Or(saturated, unusable), good);
  const auto described = hn::And(measured, lit);
  const auto bright = hn::And(
      described,
      hn::Ge(hn::Mul(v.s, v.s), hn::Mul(hn::Mul(hn::Set(d, plan.min_snr_squared), gain), q.s)));

  const V x = hn::Mul(v.x, inverse);
  const V y = hn::Mul(v.y, inverse);
  const auto inside = hn::And(hn::And(hn::Ge(x, places.min_x), hn::Le(x, places.max_x)),
                              hn::And(hn::Ge(y, places.min_y), hn::Le(y, places.max_y)));
  const auto valid = hn::And(bright, inside);
  auto state =
      hn::IfThenElse(hn::RebindMask(di, measured), named(LensletState::kFaint), places.state);
  state = hn::IfThenElse(hn::RebindMask(di, bright), named(LensletState::kAtEdge), state);
  state = hn::IfThenElse(hn::RebindMask(di, valid), named(LensletState::kValid), state);
  state = hn::IfThenElse(hn::RebindMask(di, saturated), named(LensletState::kSaturated), state);
  state = hn::IfThenElse(hn::RebindMask(di, unusable), named(LensletState::kBadPixels), state);

  const auto write = [&](V values, Image<float>& to) {
    store_first(d, hn::IfThenElseZero(described, values), n, &to[k]);
  };
  const V flux_adu = hn::Mul(v.s, hn::Set(d, plan.adu_per_count));
  store_first(d, hn::IfThenZeroElse(unusable, flux_adu), n, &out.flux_adu[k]);
  write(hn::Add(places.centre_x, x), out.x_px);
  write(hn::Add(places.centre_y, y), out.y_px);
  write(hn::Max(hn::NegMulAdd(x, x, hn::Mul(v.xx, inverse)), zero), out.xx_px2);
  write(hn::Max(hn::NegMulAdd(y, y, hn::Mul(v.yy, inverse)), zero), out.yy_px2);
  write(hn::NegMulAdd(x, y, hn::Mul(v.xy, inverse)), out.xy_px2);
  // These are second moments of q about (x, y): Σ q (u − a)(w − b) for u and w along either axis.
  const auto about = [&](V uw, V u, V w, V a, V b) {
    return hn::NegMulAdd(a, hn::NegMulAdd(b, q.s, w), hn::NegMulAdd(b, u, uw));
  };
  write(hn::Max(hn::Mul(about(q.xx, q.x, q.x, x, x), scale), zero), out.variance_x_px2);
  write(hn::Max(hn::Mul(about(q.yy, q.y, q.y, y, y), scale), zero), out.variance_y_px2);
  write(hn::Mul(about(q.xy, q.x, q.y, x, y), scale), out.covariance_xy_px2);
  const hn::Rebind<std::uint8_t, D> bytes;
  store_first(bytes, hn::DemoteTo(bytes, state), n,
              reinterpret_cast<std::uint8_t*>(out.state.data()) + k);
}

}  // namespace curlew::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // per target
