// HttpServer answers clients over HTTP from one thread of its own.
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <thread>

#include "service/http/http_request.h"

namespace curlew {

struct HttpAnswer {
  int status = 200;
  std::string content_type = "text/plain; charset=utf-8";
  std::string headers;  ///< further ones, each ending in "\r\n"
  /// Many clients may be sent the same body. Null: empty.
  std::shared_ptr<const std::string> body;
  bool keep_open = false;  ///< whether the client may ask again on the same connection
};

/// Returns an answer in plain text.
HttpAnswer plain_answer(int status, std::string text);

/// Answers a request. Nothing means "not yet": it is called again a few milliseconds later, with
/// the time that the client has been waiting.
using HttpHandler =
    std::function<std::optional<HttpAnswer>(const HttpRequest&, std::chrono::milliseconds waited)>;

/// Says where a server listens.
struct HttpAddress {
  std::string section;           ///< of the configuration, for what is said of errors
  std::string listen;            ///< ADDRESS:PORT, both numeric
  bool beyond_loopback = false;  ///< whether other machines may ask
  std::string remedy;            ///< what to set where they may, as "set beyond_loopback = true"
};

/// One thread serves all clients, a few at a time, and each has seconds for its request and for
/// taking its answer. Where too many come, the one that has kept the server waiting longest has to
/// go. So a client that is slow, silent or hostile costs itself only, and memory is bounded.
///
/// It is written by hand because cpp-httplib 0.11.4 gives every client a thread and no time limit
/// in all.
class HttpServer {
 public:
  /// handler: called from the server's thread. Throws UsageError for an address that is none or
  /// lies beyond loopback where that is not allowed, and Failure where it cannot be listened on.
  HttpServer(const HttpAddress& address, HttpHandler handler);
  ~HttpServer();
  HttpServer(const HttpServer&) = delete;
  HttpServer& operator=(const HttpServer&) = delete;

  /// Returns the port; where port 0 was asked for, the one that the system chose.
  int port() const { return port_; }

 private:
  void serve() const;

  HttpHandler handler_;
  int listening_ = -1;
  int port_ = 0;
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

}  // namespace curlew
