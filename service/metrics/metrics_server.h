// MetricsServer answers Prometheus over HTTP.
#pragma once

#include <chrono>
#include <functional>
#include <optional>
#include <string>

#include "service/http/http_server.h"
#include "service/metrics/metrics_options.h"

namespace curlew {

class MetricsServer {
 public:
  /// text: makes the answer to GET /metrics; it is called at most ten times a second, from the
  /// server's thread. Throws what HttpServer throws.
  MetricsServer(const MetricsOptions& options, std::function<std::string()> text);

  /// Returns the port; where port 0 was asked for, the one that the system chose.
  int port() const { return server_.port(); }

 private:
  HttpAnswer answer(const HttpRequest& request);

  std::function<std::string()> text_;
  std::shared_ptr<const std::string> fresh_;
  std::chrono::steady_clock::time_point made_{};
  HttpServer server_;  ///< the last, because its thread uses the others
};

}  // namespace curlew
