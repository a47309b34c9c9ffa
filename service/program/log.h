// Log: spdlog's default logger, asynchronous, so that nobody ever waits for it.
#pragma once

#include <string>

namespace curlew {

/// While it lives spdlog::info() and the like go to standard error from a thread of their own.
/// Where that thread cannot follow, the oldest lines are lost, never the caller's time.
class Log {
 public:
  /// level: debug, info, warning or error; UsageError otherwise.
  explicit Log(const std::string& level);
  ~Log();
  Log(const Log&) = delete;
  Log& operator=(const Log&) = delete;
};

}  // namespace curlew
