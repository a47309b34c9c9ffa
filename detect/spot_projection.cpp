// Compiled once for every instruction set and chosen at run time (Highway).
#include "detect/spot_projection.h"

#include <array>
#include <cstdint>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "detect/spot_projection.cpp"
#include "hwy/foreach_target.h"
// foreach_target.h comes first.

#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace curlew::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

/// Vectors run over the orders along x: a row of pixels adds to one vector (or two of half the
/// width), which then adds to the sums of all orders along y.
template <class D, typename Pixel>
float project(D d, const ProjectedWindow& window, float* HWY_RESTRICT sums) {
  using V = hn::Vec<D>;
  const auto lanes = static_cast<std::ptrdiff_t>(hn::Lanes(d));
  const auto* pixels = reinterpret_cast<const Pixel*>(window.pixels) + window.first;
  std::array<float, kProjectionLanes> totals{};
  for (std::ptrdiff_t part = 0; part < kProjectionLanes; part += lanes) {
    V sum0 = hn::Zero(d), sum1 = sum0, sum2 = sum0, sum3 = sum0, sum4 = sum0, sum5 = sum0;
    V total = sum0;
    for (int row = 0; row < window.h; ++row) {
      const std::ptrdiff_t start = row * window.frame_cols;
      const float* function = window.along_x + part;
      V along_x = hn::Zero(d);
      for (int col = 0; col < window.w; ++col, function += window.table_step) {
        auto signal = static_cast<float>(pixels[start + col]);
        if (window.gains == nullptr) {
          signal -= window.offset;
        } else {
          const std::ptrdiff_t i = window.first + start + col;
          signal = (signal - window.offsets[i]) * window.gains[i];
        }
        along_x = hn::MulAdd(hn::Set(d, signal), hn::LoadU(d, function), along_x);
      }
      total = hn::Add(total, along_x);
      const float* order = window.along_y + row * window.table_step;
      sum0 = hn::MulAdd(hn::Set(d, order[0]), along_x, sum0);
      sum1 = hn::MulAdd(hn::Set(d, order[1]), along_x, sum1);
      sum2 = hn::MulAdd(hn::Set(d, order[2]), along_x, sum2);
      sum3 = hn::MulAdd(hn::Set(d, order[3]), along_x, sum3);
      sum4 = hn::MulAdd(hn::Set(d, order[4]), along_x, sum4);
      sum5 = hn::MulAdd(hn::Set(d, order[5]), along_x, sum5);
    }
    hn::StoreU(total, d, totals.data() + part);
    hn::StoreU(sum0, d, sums + part);
    hn::StoreU(sum1, d, sums + kProjectionLanes + part);
    hn::StoreU(sum2, d, sums + std::ptrdiff_t{2} * kProjectionLanes + part);
    hn::StoreU(sum3, d, sums + std::ptrdiff_t{3} * kProjectionLanes + part);
    hn::StoreU(sum4, d, sums + std::ptrdiff_t{4} * kProjectionLanes + part);
    hn::StoreU(sum5, d, sums + std::ptrdiff_t{5} * kProjectionLanes + part);
  }
  return totals[kProjectionOnes];
}

float project_any(const ProjectedWindow& window, float* sums) {
  const hn::CappedTag<float, kProjectionLanes> d;
  return window.pixel_type == PixelType::kU16 ? project<decltype(d), std::uint16_t>(d, window, sums)
                                              : project<decltype(d), std::uint8_t>(d, window, sums);
}

}  // namespace
}  // namespace curlew::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace curlew {
namespace {
HWY_EXPORT(project_any);
}  // namespace

float project_window(const ProjectedWindow& window, float* sums) noexcept {
  return HWY_DYNAMIC_DISPATCH(project_any)(window, sums);
}

}  // namespace curlew
#endif  // HWY_ONCE
