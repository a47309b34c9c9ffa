// Highway compiles this file once for every instruction set and chooses one at run time.
#include "detect/classifier/matrix_product.h"

#include <cassert>
#include <cstddef>
#include <type_traits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "detect/classifier/matrix_product.cpp"
#include "hwy/foreach_target.h"
// Highway needs foreach_target.h before the headers below.

#include "detect/classifier/row_tiles-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace curlew::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

/// Multiplies kRows rows by kVectors (1 or 2) vectors of columns, which stay in registers over the
/// whole inner sum.
template <int kRows, int kVectors, class D, class V = hn::Vec<D>>
HWY_INLINE void multiply_tile(D d, StridedMatrix a, const float* HWY_RESTRICT b, const float* bias,
                              int inner, int columns, bool rectify, float* HWY_RESTRICT c) {
  const auto lanes = static_cast<std::ptrdiff_t>(hn::Lanes(d));
  const std::ptrdiff_t right_column = kVectors > 1 ? lanes : 0;
  const V zero = hn::Zero(d);
  const V start0 = bias != nullptr ? hn::LoadU(d, bias) : zero;
  const V start1 = bias != nullptr ? hn::LoadU(d, bias + right_column) : zero;
  V left0 = start0, left1 = start0, left2 = start0, left3 = start0, left4 = start0, left5 = start0;
  V right0 = start1, right1 = start1, right2 = start1, right3 = start1, right4 = start1,
    right5 = start1;
  // Each row has a pointer of its own, because compilers keep pointers in registers where they
  // would not keep products.
  const auto row_at = [&](int row) { return a.data + row * a.row_step; };
  const float* row0 = row_at(0);
  const float* row1 = row_at(kRows > 1 ? 1 : 0);
  const float* row2 = row_at(kRows > 2 ? 2 : 0);
  const float* row3 = row_at(kRows > 3 ? 3 : 0);
  const float* row4 = row_at(kRows > 4 ? 4 : 0);
  const float* row5 = row_at(kRows > 5 ? 5 : 0);
  for (int k = 0; k < inner; ++k, b += columns) {
    const V b0 = hn::LoadU(d, b);
    const V b1 = hn::LoadU(d, b + right_column);
    const auto add = [&](const float*& element, V& left, V& right) HWY_ATTR {
      const V factor = hn::Set(d, *element);
      left = hn::MulAdd(factor, b0, left);
      if constexpr (kVectors > 1) right = hn::MulAdd(factor, b1, right);
      element += a.column_step;
    };
    add(row0, left0, right0);
    if constexpr (kRows > 1) add(row1, left1, right1);
    if constexpr (kRows > 2) add(row2, left2, right2);
    if constexpr (kRows > 3) add(row3, left3, right3);
    if constexpr (kRows > 4) add(row4, left4, right4);
    if constexpr (kRows > 5) add(row5, left5, right5);
  }
  const auto store = [&](int row, V left, V right) HWY_ATTR {
    if (rectify) {
      left = hn::Max(left, zero);
      if constexpr (kVectors > 1) right = hn::Max(right, zero);
    }
    float* const to = c + std::ptrdiff_t{row} * columns;
    hn::StoreU(left, d, to);
    if constexpr (kVectors > 1) hn::StoreU(right, d, to + lanes);
  };
  store(0, left0, right0);
  if constexpr (kRows > 1) store(1, left1, right1);
  if constexpr (kRows > 2) store(2, left2, right2);
  if constexpr (kRows > 3) store(3, left3, right3);
  if constexpr (kRows > 4) store(4, left4, right4);
  if constexpr (kRows > 5) store(5, left5, right5);
}

template <int kVectors, class D>
void multiply_columns(D d, StridedMatrix a, const float* b, const float* bias, int rows, int inner,
                      int columns, bool rectify, float* c) {
  in_row_tiles(rows, [&](auto n, int row) HWY_ATTR {
    multiply_tile<decltype(n)::value, kVectors>(
        d, {a.data + row * a.row_step, a.row_step, a.column_step}, b, bias, inner, columns, rectify,
        c + static_cast<std::ptrdiff_t>(row) * columns);
  });
}

void multiply_all(StridedMatrix a, const float* b, const float* bias, int rows, int inner,
                  int columns, bool rectify, float* c) {
  int column = 0;
  const auto part = [&](auto vectors, auto d) HWY_ATTR {
    constexpr int kVectors = decltype(vectors)::value;
    const int width = kVectors * static_cast<int>(hn::Lanes(d));
    for (; column + width <= columns; column += width) {
      multiply_columns<kVectors>(d, a, b + column, bias != nullptr ? bias + column : nullptr, rows,
                                 inner, columns, rectify, c + column);
    }
  };
  const std::integral_constant<int, 1> one;
  const std::integral_constant<int, 2> two;
  part(two, hn::CappedTag<float, 16>());
  part(one, hn::CappedTag<float, 16>());
  part(one, hn::CappedTag<float, 8>());
}

}  // namespace
}  // namespace curlew::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace curlew {
namespace {
HWY_EXPORT(multiply_all);
}  // namespace

void multiply(StridedMatrix a, const float* b, const float* bias, int rows, int inner, int columns,
              bool rectify, float* c) noexcept {
  assert(columns % kProductColumns == 0);
  HWY_DYNAMIC_DISPATCH(multiply_all)(a, b, bias, rows, inner, columns, rectify, c);
}

}  // namespace curlew
#endif  // HWY_ONCE
