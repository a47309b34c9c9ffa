// The HTTP server: whatever comes in is refused, waited for, or one request of known length.
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "service/http/http_request.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  using namespace curlew;
  const std::string_view text(reinterpret_cast<const char*>(bytes), size);
  const ParsedRequest parsed = parse_request(text);
  if (parsed.state == HttpParse::kIncomplete) {
    if (size > kLongestHead + kLongestBody) __builtin_trap();
    return 0;
  }
  if (parsed.state != HttpParse::kComplete) return 0;
  const HttpRequest& request = parsed.request;
  if (parsed.used > size || request.body.size() > kLongestBody) __builtin_trap();
  if (request.path.empty() || request.path.front() != '/') __builtin_trap();
  if (request.header("host").size() + request.asked("a").size() > size) __builtin_trap();
  // What follows a request does not change it, and it is complete with its last byte only.
  if (parse_request(text.substr(0, parsed.used)).used != parsed.used) __builtin_trap();
  if (parse_request(text.substr(0, parsed.used - 1)).state == HttpParse::kComplete)
    __builtin_trap();
  return 0;
}
