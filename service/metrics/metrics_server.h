// MetricsServer answers Prometheus over HTTP.
#pragma once

#include <atomic>
#include <functional>
#include <string>
#include <thread>

#include "service/metrics/metrics_options.h"

namespace curlew {

/// One thread serves all clients, a few at a time and each for a few seconds at most. Where another
/// comes, the oldest has to go: so a client that is slow, silent or hostile costs itself only.
///
/// It is written by hand because cpp-httplib 0.11.4 gives every client a thread and no time limit
/// in all.
class MetricsServer {
 public:
  /// text: makes the answer to GET /metrics; it is called at most ten times a second, from the
  /// server's thread. Throws UsageError for an address that is none or lies beyond loopback without
  /// options.beyond_loopback, and Failure where it cannot be listened on.
  MetricsServer(const MetricsOptions& options, std::function<std::string()> text);
  ~MetricsServer();
  MetricsServer(const MetricsServer&) = delete;
  MetricsServer& operator=(const MetricsServer&) = delete;

  /// Returns the port; where port 0 was asked for, the one that the system chose.
  int port() const { return port_; }

 private:
  void serve();

  std::function<std::string()> text_;
  int listening_ = -1;
  int port_ = 0;
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

}  // namespace curlew
