// Rounding to whole numbers without a call of the mathematical library, for the frame path.
#pragma once

namespace curlew {

// The arguments must lie within the range of int.

/// Returns the nearest whole number, and of two as near the one farther from 0, as std::lround
/// does.
inline int round_to_int(double x) noexcept { return static_cast<int>(x + (x < 0.0 ? -0.5 : 0.5)); }

inline int floor_to_int(double x) noexcept {
  const int cut = static_cast<int>(x);
  return cut - (static_cast<double>(cut) > x ? 1 : 0);
}

inline int ceil_to_int(double x) noexcept {
  const int cut = static_cast<int>(x);
  return cut + (static_cast<double>(cut) < x ? 1 : 0);
}

}  // namespace curlew
