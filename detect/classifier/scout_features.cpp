// Highway compiles this file once for every instruction set and chooses one at run time.
#include "detect/classifier/scout_features.h"

#include <cstddef>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "detect/classifier/scout_features.cpp"
#include "hwy/foreach_target.h"
// Highway needs foreach_target.h before the header below.

#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace curlew::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

void describe_row(const ScoutRow& row, int n, float* HWY_RESTRICT features) {
  const hn::CappedTag<float, kScoutLanes> d;
  const auto stride = static_cast<std::ptrdiff_t>(n);
  const auto lanes = static_cast<std::ptrdiff_t>(hn::Lanes(d));
  for (std::ptrdiff_t c = 0; c < stride; c += lanes) {
    const auto at = [&](const float* map, int shift)
                        HWY_ATTR { return hn::LoadU(d, map + c + shift); };
    const auto add = [](auto a, auto b) HWY_ATTR { return hn::Add(a, b); };
    const auto store = [&](int feature, auto value)
                           HWY_ATTR { hn::StoreU(value, d, features + feature * stride + c); };
    const auto here = at(row.circulation, 1);
    const auto left = at(row.circulation, 0);
    const auto right = at(row.circulation, 2);
    const auto up = at(row.circulation_above, 1);
    const auto up_left = at(row.circulation_above, 0);
    const auto up_right = at(row.circulation_above, 2);
    const auto down = at(row.circulation_below, 1);
    const auto down_left = at(row.circulation_below, 0);
    const auto down_right = at(row.circulation_below, 2);
    const auto relative = [&](auto sum)
                              HWY_ATTR { return hn::Xor(sum, hn::And(here, hn::SignBit(d))); };
    store(0, hn::Set(d, 1.0F));
    store(1, hn::Abs(here));
    store(2, relative(add(add(up, down), add(left, right))));
    store(3, relative(add(add(up_left, up_right), add(down_left, down_right))));
    const auto above = add(up, here);
    const auto below = add(down, here);
    store(4, hn::Max(hn::Max(hn::Abs(add(above, add(up_left, left))),
                             hn::Abs(add(above, add(up_right, right)))),
                     hn::Max(hn::Abs(add(below, add(down_left, left))),
                             hn::Abs(add(below, add(down_right, right))))));
    const auto of_four = [&](const float* upper, const float* lower, auto&& choose) HWY_ATTR {
      return choose(choose(at(upper, 0), at(upper, 1)), choose(at(lower, 0), at(lower, 1)));
    };
    const auto minimum = [](auto a, auto b) HWY_ATTR { return hn::Min(a, b); };
    const auto maximum = [](auto a, auto b) HWY_ATTR { return hn::Max(a, b); };
    store(5, of_four(row.brightness_above, row.brightness_below, minimum));
    store(6, of_four(row.brightness_above, row.brightness_below, add));
    store(7, of_four(row.spread_above, row.spread_below, maximum));
    store(8, of_four(row.spread_above, row.spread_below, add));
    store(9, at(row.noise, 0));
  }
}

}  // namespace
}  // namespace curlew::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace curlew {
namespace {
HWY_EXPORT(describe_row);
}  // namespace

void scout_features(const ScoutRow& row, int n, float* features) noexcept {
  HWY_DYNAMIC_DISPATCH(describe_row)(row, n, features);
}

}  // namespace curlew
#endif  // HWY_ONCE
