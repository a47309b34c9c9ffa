// This file loads pixels as vectors of floats.
//
// Highway compiles it anew for every instruction set, which is why the include guard toggles.
#if defined(CURLEW_LOAD_PIXELS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef CURLEW_LOAD_PIXELS_INL_H_
#undef CURLEW_LOAD_PIXELS_INL_H_
#else
#define CURLEW_LOAD_PIXELS_INL_H_
#endif

#include <cstdint>

#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace curlew::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

template <class D>
hn::Vec<D> load_pixels(D d, const std::uint16_t* p) {
  const hn::Rebind<std::uint16_t, D> narrow;
  const hn::Rebind<std::int32_t, D> wide;
  return hn::ConvertTo(d, hn::PromoteTo(wide, hn::LoadU(narrow, p)));
}

template <class D>
hn::Vec<D> load_pixels(D d, const std::uint8_t* p) {
  const hn::Rebind<std::uint8_t, D> narrow;
  const hn::Rebind<std::int32_t, D> wide;
  return hn::ConvertTo(d, hn::PromoteTo(wide, hn::LoadU(narrow, p)));
}

}  // namespace curlew::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // per target
