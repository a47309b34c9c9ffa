// PageOptions say where the live page is served, and what it may do.
#pragma once

#include <string>

namespace curlew {

/// Section [page].
struct PageOptions {
  std::string listen;  ///< ADDRESS:PORT, as "127.0.0.1:8080"; empty: there is no page
  /// The file with the token by which other machines may see the page; empty: none may. It is a
  /// file of its own, because recordings and results carry the configuration.
  std::string token_file;
  bool control = false;  ///< whether the page may change settings
};

}  // namespace curlew
