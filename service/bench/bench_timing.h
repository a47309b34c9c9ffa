// Times things that take microseconds.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <span>
#include <vector>

#include "core/median.h"

namespace curlew {

/// Returns how long it takes to do something, in µs.
template <typename Do>
double time_us(Do something) {
  const auto start = std::chrono::steady_clock::now();
  something();
  return std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - start)
      .count();
}

/// Returns the median like median_of(), but leaves the caller's values in their order.
inline double median(std::vector<double> values) { return median_of(std::span(values)); }

/// Returns the value that has the given part of all values below it. part lies in [0, 1], and there
/// must be a value.
inline double quantile(std::vector<double> values, double part) {
  const auto n = static_cast<double>(values.size());
  const auto rank = static_cast<std::ptrdiff_t>(std::min(part * n, n - 1.0));
  std::nth_element(values.begin(), values.begin() + rank, values.end());
  return values[static_cast<std::size_t>(rank)];
}

}  // namespace curlew
