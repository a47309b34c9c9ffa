// A digest of bytes, by which a damaged file, or one file in place of another, is recognised.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>

namespace curlew {

/// Adds up bytes, eight at a time, as FNV-1a does single ones (G. Fowler, L. C. Noll, K.-P. Vo),
/// and turns the sum so that its upper bits reach the lower ones. It is no protection against who
/// wants to be taken for another.
class BytesDigest {
 public:
  /// Adds a block, whose last bytes are filled up with zeros to eight.
  void add(std::span<const std::byte> bytes) noexcept {
    std::size_t i = 0;
    for (; i + sizeof(std::uint64_t) <= bytes.size(); i += sizeof(std::uint64_t)) {
      std::uint64_t word;
      std::memcpy(&word, bytes.data() + i, sizeof word);
      add_word(word);
    }
    if (i == bytes.size()) return;
    std::uint64_t word = 0;
    std::memcpy(&word, bytes.data() + i, bytes.size() - i);
    add_word(word);
  }
  std::uint64_t value() const { return value_; }

 private:
  void add_word(std::uint64_t word) noexcept {
    value_ = std::rotl((value_ ^ word) * 0x100000001b3U, 29);
  }
  std::uint64_t value_ = 0xcbf29ce484222325U;
};

}  // namespace curlew
