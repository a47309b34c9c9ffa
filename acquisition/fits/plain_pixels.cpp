#include "acquisition/fits/plain_pixels.h"

#include <fcntl.h>
#include <unistd.h>

#include <bit>
#include <cerrno>

namespace curlew {
namespace {

/// A disk that turns takes about 10 ms to begin, in which it could have read a tenth of this.
constexpr std::int64_t kAhead_bytes = 16 << 20;

}  // namespace

void SequentialReader::look_ahead(int file, std::int64_t place) {
  if (place > asked_ || place < asked_ - 2 * kAhead_bytes) asked_ = place;
  if (place + kAhead_bytes / 2 < asked_) return;
  // Without this, reading is only slower, so its errors do not count.
  posix_fadvise(file, static_cast<off_t>(asked_), static_cast<off_t>(kAhead_bytes),
                POSIX_FADV_WILLNEED);
  asked_ += kAhead_bytes;
}

bool SequentialReader::read(int file, std::int64_t place, std::span<std::byte> into) {
  look_ahead(file, place + static_cast<std::int64_t>(into.size()));
  while (!into.empty()) {
    const ssize_t n = pread(file, into.data(), into.size(), static_cast<off_t>(place));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    into = into.subspan(static_cast<std::size_t>(n));
    place += n;
  }
  return true;
}

void order_bytes(std::span<std::uint16_t> pixels, bool shifted) {
  static_assert(std::endian::native == std::endian::little);
  const unsigned sign = shifted ? 0x8000U : 0U;
  for (std::uint16_t& pixel : pixels) {
    const unsigned stored = pixel;
    pixel = static_cast<std::uint16_t>(((stored << 8U) | (stored >> 8U)) ^ sign);
  }
}

}  // namespace curlew
