// A digest of bytes, by which a damaged file, or one file in place of another, is recognised.
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>

namespace curlew {

/// Adds up bytes in four sums, each of every fourth eight bytes, as FNV-1a does single ones
/// (G. Fowler, L. C. Noll, K.-P. Vo), and turns each sum so that its upper bits reach the lower
/// ones. A processor works on the four at once. It is no protection against who wants to be taken
/// for another.
class BytesDigest {
 public:
  static constexpr std::size_t kStride_bytes = 32;

  /// Adds a block, whose last bytes are filled up with zeros to kStride_bytes.
  void add(std::span<const std::byte> bytes) noexcept {
    while (bytes.size() >= kStride_bytes) {
      add_stride(bytes.data());
      bytes = bytes.subspan(kStride_bytes);
    }
    if (bytes.empty()) return;
    std::array<std::byte, kStride_bytes> last{};
    std::memcpy(last.data(), bytes.data(), bytes.size());
    add_stride(last.data());
  }
  std::uint64_t value() const noexcept {
    std::uint64_t all = sums_[0];
    for (std::size_t i = 1; i < sums_.size(); ++i) all = turned(all, sums_[i]);
    return all;
  }

 private:
  static std::uint64_t turned(std::uint64_t sum, std::uint64_t word) noexcept {
    return std::rotl((sum ^ word) * 0x100000001b3U, 29);
  }
  void add_stride(const std::byte* bytes) noexcept {
    for (std::uint64_t& sum : sums_) {
      std::uint64_t word;
      std::memcpy(&word, bytes, sizeof word);
      sum = turned(sum, word);
      bytes += sizeof word;
    }
  }
  std::array<std::uint64_t, 4> sums_{0xcbf29ce484222325U, 0x84222325cbf29ce4U, 0x2325cbf29ce48422U,
                                     0x9ce484222325cbf2U};
};

}  // namespace curlew
