#include "service/metrics/metrics_server.h"

#include <utility>

namespace curlew {
namespace {

constexpr auto kTextAge = std::chrono::milliseconds(100);

}  // namespace

MetricsServer::MetricsServer(const MetricsOptions& options, std::function<std::string()> text)
    : text_(std::move(text)),
      server_({"metrics", options.listen, options.beyond_loopback, "set beyond_loopback = true"},
              [this](const HttpRequest& request, std::chrono::milliseconds) {
                return answer(request);
              }) {}

HttpAnswer MetricsServer::answer(const HttpRequest& request) {
  if (request.method != "GET" && request.method != "HEAD")
    return plain_answer(405, "only GET is answered\n");
  if (request.path != "/metrics") return plain_answer(404, "the metrics are at /metrics\n");
  const auto now = std::chrono::steady_clock::now();
  if (!fresh_ || now - made_ > kTextAge) {
    fresh_ = std::make_shared<const std::string>(text_());
    made_ = now;
  }
  HttpAnswer made;
  made.content_type = "text/plain; version=0.0.4; charset=utf-8";
  made.body = fresh_;
  return made;
}

}  // namespace curlew
