// A StageTimer times a scope with the steady clock.
#pragma once

#include <chrono>
#include <cstdint>

namespace curlew {

inline std::int64_t nanoseconds_since(std::chrono::steady_clock::time_point start) noexcept {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now() -
                                                              start)
      .count();
}

/// Writes how long it has lived, in ns, to `duration_ns` when it is destroyed.
class StageTimer {
 public:
  explicit StageTimer(std::int64_t& duration_ns) noexcept : duration_ns_(duration_ns) {}
  ~StageTimer() { duration_ns_ = nanoseconds_since(start_); }
  StageTimer(const StageTimer&) = delete;
  StageTimer& operator=(const StageTimer&) = delete;

 private:
  std::int64_t& duration_ns_;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace curlew
