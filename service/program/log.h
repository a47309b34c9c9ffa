// Log: spdlog's default logger, which is asynchronous, so that no caller waits for it.
#pragma once

#include <memory>
#include <string>

namespace curlew {

/// While it lives, spdlog::info() and its siblings write to standard error from a thread of their
/// own. If that thread cannot follow, the oldest lines are lost, and the caller never waits. At the
/// end of its life lines that nobody reads are lost as well.
class Log {
 public:
  /// level: debug, info, warning or error. Throws UsageError for any other word.
  explicit Log(const std::string& level);
  ~Log();
  Log(const Log&) = delete;
  Log& operator=(const Log&) = delete;

 private:
  class Sink;
  std::shared_ptr<Sink> sink_;
};

}  // namespace curlew
