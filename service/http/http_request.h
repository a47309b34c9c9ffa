// HttpRequest: what a client asks, read from bytes that anybody may send.
#pragma once

#include <chrono>
#include <cstddef>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace curlew {

struct HttpRequest {
  std::string method;  ///< as "GET"
  std::string path;    ///< as "/frame"; it begins with a slash and ends before a question mark
  std::string query;   ///< what follows the question mark, as "after=7"
  std::vector<std::pair<std::string, std::string>> headers;  ///< names in small letters
  std::string body;
  std::string peer;  ///< the client's numeric address and port, where the server knows it
  /// how long before this request its connection had its last answer, or began
  std::chrono::milliseconds since_answer{0};

  /// Returns the value of a header, by its name in small letters; empty where there is none.
  std::string header(std::string_view name) const;
  /// Returns the value of NAME=VALUE in the query; empty where there is none.
  std::string asked(std::string_view name) const;
};

enum class HttpParse {
  kIncomplete,  ///< more bytes have to come
  kComplete,
  kBad,      ///< this is no HTTP/1, or its body has no plain length
  kTooLong,  ///< head or body are longer than anybody needs
};

inline constexpr std::size_t kLongestHead = 16384;  ///< bytes, with the empty line
inline constexpr std::size_t kLongestBody = 4096;   ///< bytes

struct ParsedRequest {
  HttpParse state = HttpParse::kIncomplete;
  HttpRequest request;   ///< if complete
  std::size_t used = 0;  ///< if complete: the bytes that were the request; others may follow
};

/// Reads the first request of the bytes. A request is refused whose body comes in chunks, and one
/// that names two lengths.
ParsedRequest parse_request(std::string_view bytes);

}  // namespace curlew
