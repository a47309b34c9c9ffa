#include "service/http/http_request.h"

#include <algorithm>
#include <charconv>

namespace curlew {
namespace {

constexpr std::string_view kLineEnd = "\r\n";

char small(char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; }

std::string_view trimmed(std::string_view text) {
  const std::size_t first = text.find_first_not_of(" \t");
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(" \t") - first + 1);
}

bool is_plain(std::string_view text) {
  return std::ranges::all_of(text, [](char c) { return c > ' ' && c < '\x7f'; });
}

/// Reads "GET /path?query HTTP/1.1". Returns false for anything else.
bool read_first_line(std::string_view line, HttpRequest& request) {
  const std::size_t first = line.find(' ');
  const std::size_t second = line.find(' ', first + 1);
  if (first == std::string_view::npos || second == std::string_view::npos) return false;
  const std::string_view target = line.substr(first + 1, second - first - 1);
  const std::string_view version = line.substr(second + 1);
  if (version != "HTTP/1.1" && version != "HTTP/1.0") return false;
  if (first == 0 || target.empty() || target.front() != '/') return false;
  if (!is_plain(line.substr(0, first)) || !is_plain(target)) return false;
  request.method = line.substr(0, first);
  const std::size_t question = std::min(target.find('?'), target.size());
  request.path = target.substr(0, question);
  request.query = target.substr(std::min(question + 1, target.size()));
  return true;
}

bool read_header(std::string_view line, HttpRequest& request) {
  const std::size_t colon = line.find(':');
  if (colon == std::string_view::npos || colon == 0 || !is_plain(line.substr(0, colon)))
    return false;
  std::string name(line.substr(0, colon));
  std::ranges::transform(name, name.begin(), small);
  request.headers.emplace_back(std::move(name), trimmed(line.substr(colon + 1)));
  return true;
}

/// Reads how long the body is. Returns false where that is not plain.
bool read_length(const HttpRequest& request, std::size_t& length) {
  length = 0;
  bool known = false;
  for (const auto& [name, value] : request.headers) {
    if (name == "transfer-encoding") return false;
    if (name != "content-length") continue;
    const char* end = value.data() + value.size();
    const auto [stop, error] = std::from_chars(value.data(), end, length);
    if (known || value.empty() || error != std::errc{} || stop != end) return false;
    known = true;
  }
  return true;
}

}  // namespace

std::string HttpRequest::header(std::string_view name) const {
  for (const auto& [known, value] : headers)
    if (known == name) return value;
  return {};
}

std::string HttpRequest::asked(std::string_view name) const {
  std::string_view rest = query;
  while (!rest.empty()) {
    const std::string_view part = rest.substr(0, rest.find('&'));
    rest.remove_prefix(std::min(part.size() + 1, rest.size()));
    const std::size_t equals = part.find('=');
    if (equals != std::string_view::npos && part.substr(0, equals) == name)
      return std::string(part.substr(equals + 1));
  }
  return {};
}

ParsedRequest parse_request(std::string_view bytes) {
  ParsedRequest parsed;
  const std::size_t end = bytes.substr(0, kLongestHead).find("\r\n\r\n");
  if (end == std::string_view::npos) {
    if (bytes.size() >= kLongestHead) parsed.state = HttpParse::kTooLong;
    return parsed;
  }
  parsed.state = HttpParse::kBad;
  std::string_view head = bytes.substr(0, end + kLineEnd.size());
  for (bool first = true; !head.empty(); first = false) {
    const std::string_view line = head.substr(0, head.find(kLineEnd));
    head.remove_prefix(line.size() + kLineEnd.size());
    const bool read =
        first ? read_first_line(line, parsed.request) : read_header(line, parsed.request);
    if (!read) return parsed;
  }
  std::size_t length = 0;
  if (!read_length(parsed.request, length)) return parsed;
  const std::size_t start = end + 2 * kLineEnd.size();
  if (length > kLongestBody) {
    parsed.state = HttpParse::kTooLong;
  } else if (bytes.size() - start < length) {
    parsed.state = HttpParse::kIncomplete;
  } else {
    parsed.state = HttpParse::kComplete;
    parsed.request.body = bytes.substr(start, length);
    parsed.used = start + length;
  }
  return parsed;
}

}  // namespace curlew
