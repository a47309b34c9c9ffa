// Texts of others, made harmless for logs and terminals.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace curlew {

/// Returns the text with every control character as \xNN, so that it is one line and commands no
/// terminal. The rest of UTF-8 stays as it is.
inline std::string printable(std::string_view text) {
  constexpr std::string_view kDigits = "0123456789abcdef";
  std::string result;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const auto byte = static_cast<unsigned char>(text[i]);
    // C2 80 to C2 9F are the control characters beyond ASCII.
    const bool is_c1 = byte >= 0x80 && byte < 0xA0 && i > 0 && text[i - 1] == '\xC2';
    if (byte >= 0x20 && byte != 0x7F && !is_c1) {
      result += text[i];
    } else {
      result += "\\x";
      result += kDigits[byte >> 4U];
      result += kDigits[byte & 0xFU];
    }
  }
  return result;
}

}  // namespace curlew
