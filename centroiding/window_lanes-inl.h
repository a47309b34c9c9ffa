// This file holds what all methods on window groups share. Each lane of a vector is one lenslet,
// and no sum ever runs across lanes.
//
// Highway compiles it anew for every instruction set, which is why the include guard toggles.
#if defined(CURLEW_WINDOW_LANES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef CURLEW_WINDOW_LANES_INL_H_
#undef CURLEW_WINDOW_LANES_INL_H_
#else
#define CURLEW_WINDOW_LANES_INL_H_
#endif

#include <cstddef>

#include "centroiding/window_group.h"
#include "hwy/contrib/math/math-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace curlew::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::CappedTag<float, kMaxLanes>;
using V = hn::Vec<D>;
using M = hn::Mask<D>;
inline constexpr D d;

inline V set(float value) { return hn::Set(d, value); }
inline V load(const LaneValues& values) { return hn::LoadU(d, values.data()); }
inline void store(V value, LaneValues& to) { hn::StoreU(value, d, to.data()); }
inline std::size_t lane_count() { return hn::Lanes(d); }

/// These are the pixels of a group and their noise.
struct Windows {
  const WindowGroup& group;
  const float* light;
  std::size_t w, h;
  V per_count;  ///< A pixel's variance is per_count·I + constant, counts².
  V constant;

  V at(std::size_t y, std::size_t x) const {
    return hn::LoadU(d, light + (y * w + x) * lane_count());
  }
};

/// An Axis samples, at the pixels of one axis, a Gaussian g of height 1 about a position: g, g·u
/// and g·u², where u is the distance from the position. All are 0 beyond the window.
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

inline V clamped(V value, V limit) { return hn::Max(hn::Min(value, limit), hn::Neg(limit)); }

/// Returns x / y, and 0 where y is not positive.
inline V ratio(V x, V y) {
  const M ok = hn::Gt(y, hn::Zero(d));
  return hn::IfThenElseZero(ok, hn::Div(x, hn::IfThenElse(ok, y, set(1.0F))));
}

}  // namespace curlew::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // per target
