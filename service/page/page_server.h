// PageServer serves the live page.
#pragma once

#include <chrono>
#include <functional>
#include <optional>
#include <string>

#include "service/http/http_server.h"
#include "service/page/page_options.h"
#include "service/page/page_source.h"

namespace curlew {

/// Takes the body of a request for a change and the address that it came from. Returns nothing if
/// the change was made, or a sentence on why not.
using PageControl = std::function<std::string(const std::string& body, const std::string& peer)>;

class PageServer {
 public:
  /// source: outlives the server; it is asked from the server's thread only. control: null where
  /// the page may change nothing. Throws UsageError for an address beyond loopback without a token,
  /// for a file that holds none of at least 16 letters and digits, and what HttpServer throws.
  PageServer(const PageOptions& options, PageSource& source, PageControl control = {});

  /// Returns where a browser finds the page; where it needs a token, that has to be added.
  std::string url() const;

 private:
  std::optional<HttpAnswer> answer(const HttpRequest& request,
                                   std::chrono::milliseconds waited) const;
  std::optional<HttpAnswer> show(const HttpRequest& request,
                                 std::chrono::milliseconds waited) const;
  HttpAnswer change(const HttpRequest& request) const;
  bool may_see(const HttpRequest& request) const;

  std::string listen_;
  std::string token_;  ///< empty: none is needed
  PageSource& source_;
  PageControl control_;
  HttpServer server_;  ///< the last, because its thread uses the others
};

}  // namespace curlew
