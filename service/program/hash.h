// 64-bit FNV-1a (G. Fowler, L. C. Noll, K.-P. Vo), for the names of cached files and the hash of
// the configuration.
#pragma once

#include <cstdint>
#include <sstream>
#include <string>
#include <string_view>

namespace curlew {

/// Returns the hash of a text. It is the same on every machine.
inline std::uint64_t fnv1a(std::string_view text) {
  std::uint64_t hash = 0xcbf29ce484222325U;
  for (const char c : text) {
    hash ^= static_cast<unsigned char>(c);
    hash *= 0x100000001b3U;
  }
  return hash;
}

/// Returns the hash in hexadecimal.
inline std::string hash_text(std::string_view text) {
  std::ostringstream hexadecimal;
  hexadecimal << std::hex << fnv1a(text);
  return hexadecimal.str();
}

}  // namespace curlew
