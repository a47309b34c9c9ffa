// Tests wait for other threads and processes by this.
#pragma once

#include <chrono>
#include <functional>
#include <thread>

namespace curlew {

/// Returns false if the condition did not come true in time.
inline bool eventually(const std::function<bool()>& condition,
                       std::chrono::seconds within = std::chrono::seconds(60)) {
  const auto until = std::chrono::steady_clock::now() + within;
  while (std::chrono::steady_clock::now() < until) {
    if (condition()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  return false;
}

}  // namespace curlew
