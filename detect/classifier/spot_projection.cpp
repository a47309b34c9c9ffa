// Highway compiles this file once for every instruction set and chooses one at run time.
#include "detect/classifier/spot_projection.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cstdint>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "detect/classifier/spot_projection.cpp"
#include "hwy/foreach_target.h"
// Highway needs foreach_target.h before the headers below.

#include "hwy/contrib/math/math-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace curlew::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

using Tag = hn::CappedTag<float, kProjectionLanes>;

/// Returns the signals of the columns [first, first + Lanes) of the frame's row-major pixels.
template <typename Pixel>
HWY_INLINE hn::Vec<Tag> read_signals(const ProjectedFrame& frame, float level,
                                     std::ptrdiff_t first) {
  const Tag d;
  const hn::Rebind<std::int32_t, Tag> to_int;
  const hn::Rebind<Pixel, Tag> of_pixels;
  const auto* pixels = reinterpret_cast<const Pixel*>(frame.pixels) + first;
  const auto counts = hn::ConvertTo(d, hn::PromoteTo(to_int, hn::LoadU(of_pixels, pixels)));
  if (frame.gains == nullptr) return hn::Sub(counts, hn::Set(d, frame.offset + level));
  const auto gains = hn::LoadU(d, frame.gains + first);
  const auto signals = hn::Mul(hn::Sub(counts, hn::LoadU(d, frame.offsets + first)), gains);
  return hn::IfThenElseZero(hn::Ne(gains, hn::Zero(d)), hn::Sub(signals, hn::Set(d, level)));
}

/// Projects a window and returns the sum of its signal. `sums` is [orders along y,
/// kProjectionLanes]. The signals are first summed down the columns, kProjectionLanes of them at a
/// time, onto the orders along y. Each of these sums then multiplies a vector over the orders along
/// x.
template <typename Pixel>
HWY_INLINE float project(const ProjectedFrame& frame, const ProjectedWindow& window,
                         float* HWY_RESTRICT sums) {
  using V = hn::Vec<Tag>;
  const Tag d;
  const auto lanes = static_cast<std::ptrdiff_t>(hn::Lanes(d));
  constexpr std::ptrdiff_t kL = kProjectionLanes;
  alignas(32) std::array<float, std::size_t{kProjectionOrders + 1} * kL> columns;
  float total = 0.0F;
  const float* along_x = frame.table + window.along_x;
  for (int col = 0; col < window.w; col += kProjectionLanes) {
    // Whole vectors are read. Columns past the window are read and not used, but nothing is read
    // past the frame's end.
    const std::ptrdiff_t last_row = window.first + (window.h - 1) * frame.cols + col;
    const std::ptrdiff_t past = std::max<std::ptrdiff_t>(0, last_row + kL - frame.size);
    for (std::ptrdiff_t part = 0; part < kL; part += lanes) {
      V sum0 = hn::Zero(d), sum1 = sum0, sum2 = sum0, sum3 = sum0, sum4 = sum0, sum5 = sum0;
      V ones = sum0;
      const float* order = frame.table + window.along_y;
      std::ptrdiff_t first = window.first + col - past + part;
      for (int row = 0; row < window.h; ++row, first += frame.cols, order += frame.table_step) {
        const V signal = read_signals<Pixel>(frame, window.level, first);
        sum0 = hn::MulAdd(hn::Set(d, order[0]), signal, sum0);
        sum1 = hn::MulAdd(hn::Set(d, order[1]), signal, sum1);
        sum2 = hn::MulAdd(hn::Set(d, order[2]), signal, sum2);
        sum3 = hn::MulAdd(hn::Set(d, order[3]), signal, sum3);
        sum4 = hn::MulAdd(hn::Set(d, order[4]), signal, sum4);
        sum5 = hn::MulAdd(hn::Set(d, order[5]), signal, sum5);
        ones = hn::Add(ones, signal);
      }
      float* const to = columns.data() + part;
      hn::StoreU(sum0, d, to);
      hn::StoreU(sum1, d, to + kL);
      hn::StoreU(sum2, d, to + 2 * kL);
      hn::StoreU(sum3, d, to + 3 * kL);
      hn::StoreU(sum4, d, to + 4 * kL);
      hn::StoreU(sum5, d, to + 5 * kL);
      hn::StoreU(ones, d, to + 6 * kL);
    }
    const std::ptrdiff_t n = std::min(kProjectionLanes, window.w - col);
    for (std::ptrdiff_t part = 0; part < kL; part += lanes) {
      V sum0 = hn::Zero(d), sum1 = sum0, sum2 = sum0, sum3 = sum0, sum4 = sum0, sum5 = sum0;
      if (col > 0) {
        sum0 = hn::LoadU(d, sums + part);
        sum1 = hn::LoadU(d, sums + part + kL);
        sum2 = hn::LoadU(d, sums + part + 2 * kL);
        sum3 = hn::LoadU(d, sums + part + 3 * kL);
        sum4 = hn::LoadU(d, sums + part + 4 * kL);
        sum5 = hn::LoadU(d, sums + part + 5 * kL);
      }
      const float* column = columns.data() + past;
      const float* function = along_x + part;
      for (std::ptrdiff_t i = 0; i < n; ++i, ++column, function += frame.table_step) {
        const V functions = hn::LoadU(d, function);
        sum0 = hn::MulAdd(hn::Set(d, column[0]), functions, sum0);
        sum1 = hn::MulAdd(hn::Set(d, column[kL]), functions, sum1);
        sum2 = hn::MulAdd(hn::Set(d, column[2 * kL]), functions, sum2);
        sum3 = hn::MulAdd(hn::Set(d, column[3 * kL]), functions, sum3);
        sum4 = hn::MulAdd(hn::Set(d, column[4 * kL]), functions, sum4);
        sum5 = hn::MulAdd(hn::Set(d, column[5 * kL]), functions, sum5);
      }
      hn::StoreU(sum0, d, sums + part);
      hn::StoreU(sum1, d, sums + part + kL);
      hn::StoreU(sum2, d, sums + part + 2 * kL);
      hn::StoreU(sum3, d, sums + part + 3 * kL);
      hn::StoreU(sum4, d, sums + part + 4 * kL);
      hn::StoreU(sum5, d, sums + part + 5 * kL);
    }
    for (std::ptrdiff_t i = 0; i < n; ++i)
      total += columns[static_cast<std::size_t>(6 * kL + past + i)];
    along_x += n * frame.table_step;
  }
  return total;
}

template <typename Pixel>
void project_each(const ProjectedFrame& frame, const ProjectedWindow* windows, int n,
                  std::ptrdiff_t stride, float* HWY_RESTRICT modes, float* HWY_RESTRICT fluxes) {
  const Tag d;
  const auto lanes = static_cast<std::ptrdiff_t>(hn::Lanes(d));
  alignas(32) std::array<float, std::size_t{kProjectionOrders} * kProjectionLanes> sums;
  for (int i = 0; i < n; ++i, modes += stride) {
    const ProjectedWindow& window = windows[i];
    if (window.w == 0) sums.fill(0.0F);
    const float flux = flux_of(frame, window, project<Pixel>(frame, window, sums.data()));
    fluxes[i] = flux;
    const float even = frame.e_per_count / flux;
    // Whole vectors are written. What an order has too many of, the next order overwrites.
    float* to = modes;
    for (std::ptrdiff_t order = 0; order < kProjectionOrders; ++order) {
      const auto factor = hn::Set(d, order % 2 == 1 ? frame.row_sign * even : even);
      for (std::ptrdiff_t part = 0; part < kProjectionLanes; part += lanes) {
        const auto sum = hn::LoadU(d, sums.data() + order * kProjectionLanes + part);
        hn::StoreU(hn::Mul(sum, factor), d, to + part);
      }
      to += kProjectionOrders - order;
    }
  }
}

void project_all(const ProjectedFrame& frame, const ProjectedWindow* windows, int n,
                 std::ptrdiff_t stride, float* modes, float* fluxes) {
  if (frame.pixel_type == PixelType::kU16) {
    project_each<std::uint16_t>(frame, windows, n, stride, modes, fluxes);
  } else {
    project_each<std::uint8_t>(frame, windows, n, stride, modes, fluxes);
  }
}

/// Projects a window as in the training. Vectors run over the orders along x. A row of pixels adds
/// to one vector (or to two of half the width), which then adds to the sums of all orders along y.
template <class D, typename Pixel>
float project_taught(D d, const ProjectedFrame& frame, const ProjectedWindow& window,
                     float* HWY_RESTRICT sums) {
  using V = hn::Vec<D>;
  const auto lanes = static_cast<std::ptrdiff_t>(hn::Lanes(d));
  const auto* pixels = reinterpret_cast<const Pixel*>(frame.pixels) + window.first;
  std::array<float, kProjectionLanes> totals{};
  for (std::ptrdiff_t part = 0; part < kProjectionLanes; part += lanes) {
    V sum0 = hn::Zero(d), sum1 = sum0, sum2 = sum0, sum3 = sum0, sum4 = sum0, sum5 = sum0;
    V total = sum0;
    for (int row = 0; row < window.h; ++row) {
      const std::ptrdiff_t start = row * frame.cols;
      const float* function = frame.table + window.along_x + part;
      V along_x = hn::Zero(d);
      for (int col = 0; col < window.w; ++col, function += frame.table_step) {
        auto signal = static_cast<float>(pixels[start + col]);
        if (frame.gains == nullptr) {
          signal -= frame.offset + window.level;
        } else {
          const std::ptrdiff_t i = window.first + start + col;
          signal = (signal - frame.offsets[i]) * frame.gains[i];
          signal -= frame.gains[i] != 0.0F ? window.level : 0.0F;
        }
        along_x = hn::MulAdd(hn::Set(d, signal), hn::LoadU(d, function), along_x);
      }
      total = hn::Add(total, along_x);
      const float* order = frame.table + window.along_y + row * frame.table_step;
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

float project_one(const ProjectedFrame& frame, const ProjectedWindow& window, float* sums) {
  const Tag d;
  return frame.pixel_type == PixelType::kU16
             ? project_taught<Tag, std::uint16_t>(d, frame, window, sums)
             : project_taught<Tag, std::uint8_t>(d, frame, window, sums);
}

void logarithms(int n, float* values) {
  const Tag d;
  for (int i = 0; i < n; i += static_cast<int>(hn::Lanes(d)))
    hn::StoreU(hn::Log(d, hn::LoadU(d, values + i)), d, values + i);
}

}  // namespace
}  // namespace curlew::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace curlew {
namespace {
HWY_EXPORT(project_all);
HWY_EXPORT(project_one);
HWY_EXPORT(logarithms);
}  // namespace

void project_windows(const ProjectedFrame& frame, const ProjectedWindow* windows, int n,
                     std::ptrdiff_t stride, float* modes, float* fluxes) noexcept {
  HWY_DYNAMIC_DISPATCH(project_all)(frame, windows, n, stride, modes, fluxes);
}

float project_window(const ProjectedFrame& frame, const ProjectedWindow& window,
                     float* modes) noexcept {
  std::array<float, std::size_t{kProjectionOrders} * kProjectionLanes> sums;
  const float total = HWY_DYNAMIC_DISPATCH(project_one)(frame, window, sums.data());
  const float flux = flux_of(frame, window, total);
  const float inverse = 1.0F / flux;
  for (std::size_t n = 0; n < kProjectionOrders; ++n) {
    const float scale = (n % 2 == 1 ? frame.row_sign : 1.0F) * frame.e_per_count * inverse;
    for (std::size_t m = 0; m + n < kProjectionOrders; ++m)
      *modes++ = sums[n * kProjectionLanes + m] * scale;
  }
  return flux;
}

void take_logarithms(int n, float* values) noexcept {
  assert(n % kProjectionLanes == 0);
  HWY_DYNAMIC_DISPATCH(logarithms)(n, values);
}

}  // namespace curlew
#endif  // HWY_ONCE
