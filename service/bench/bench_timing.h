// Times things that take microseconds.
#pragma once

#include <chrono>
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

}  // namespace curlew
