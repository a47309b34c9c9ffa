#include "core/memory_limit.h"

#include <charconv>
#include <cmath>
#include <cstdlib>
#include <string_view>

#include "core/error.h"

namespace curlew {
namespace {

constexpr std::int64_t kDefault_mb = 1024;
constexpr std::int64_t kMost_mb = std::int64_t{1} << 40;
constexpr std::int64_t kBytesPerMb = 1'000'000;

std::int64_t memory_limit_mb() {
  // getenv() is safe among threads here, because nothing in the program sets a variable.
  const char* const text = std::getenv("CURLEW_MEMORY_MB");  // NOLINT(concurrency-mt-unsafe)
  if (text == nullptr) return kDefault_mb;
  const std::string_view word(text);
  std::int64_t value = 0;
  const auto read = std::from_chars(word.data(), word.data() + word.size(), value);
  const bool is_sane = read.ec == std::errc() && read.ptr == word.data() + word.size() &&
                       value > 0 && value < kMost_mb;
  return is_sane ? value : kDefault_mb;
}

}  // namespace

std::int64_t memory_limit_bytes() { return memory_limit_mb() * kBytesPerMb; }

void require_memory(const std::string& what, double bytes) {
  if (bytes <= static_cast<double>(memory_limit_bytes())) return;
  throw Failure(what + " takes " +
                std::to_string(std::llround(bytes / static_cast<double>(kBytesPerMb))) +
                " MB of memory, and " + std::to_string(memory_limit_mb()) +
                " MB is the limit; CURLEW_MEMORY_MB in the environment sets another");
}

}  // namespace curlew
