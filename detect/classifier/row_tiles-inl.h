// This file says how a matrix product goes through its rows: as many at once as registers hold.
//
// Highway compiles it anew for every instruction set, which is why the include guard toggles.
#if defined(CURLEW_ROW_TILES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef CURLEW_ROW_TILES_INL_H_
#undef CURLEW_ROW_TILES_INL_H_
#else
#define CURLEW_ROW_TILES_INL_H_
#endif

#include <type_traits>

#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace curlew::HWY_NAMESPACE {

/// Calls tile(rows, first) for n rows, six at a time and then those that are left. The type of
/// `rows` holds its number as a constant.
template <class Tile>
HWY_INLINE void in_row_tiles(int n, const Tile& tile) {
  constexpr int kRows = 6;
  int first = 0;
  for (; first + kRows <= n; first += kRows) tile(std::integral_constant<int, kRows>(), first);
  switch (n - first) {
    case 5:
      return tile(std::integral_constant<int, 5>(), first);
    case 4:
      return tile(std::integral_constant<int, 4>(), first);
    case 3:
      return tile(std::integral_constant<int, 3>(), first);
    case 2:
      return tile(std::integral_constant<int, 2>(), first);
    case 1:
      return tile(std::integral_constant<int, 1>(), first);
    default:
      return;
  }
}

}  // namespace curlew::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // CURLEW_ROW_TILES_INL_H_
