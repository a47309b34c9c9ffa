// This file finds the median of values that may be reordered.
#pragma once

#include <algorithm>
#include <cstddef>
#include <limits>
#include <span>

namespace curlew {

/// Returns the middle value, the mean of the middle two if their number is even, or NaN if there is
/// no value. Reorders the values and allocates nothing.
template <typename T>
T median_of(std::span<T> values) noexcept {
  if (values.empty()) return std::numeric_limits<T>::quiet_NaN();
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  if (values.size() % 2 == 1) return *middle;
  return T{0.5} * (*std::max_element(values.begin(), middle) + *middle);
}

}  // namespace curlew
