// This is the wall clock, as files and headers carry it. Latency is never counted by it.
#pragma once

#include <chrono>
#include <cstdint>

namespace curlew {

/// Returns UTC in nanoseconds since 1970.
inline std::int64_t utc_now_ns() noexcept {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

}  // namespace curlew
