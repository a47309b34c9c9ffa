// Both ends of an UnpackingProcess share this.
#pragma once

#include <unistd.h>

#include <cerrno>
#include <cstddef>
#include <cstdint>

namespace curlew {

/// The argument by which the program knows that it shall unpack.
constexpr const char* kUnpackArgument = "--unpack-fits";
/// The descriptors that the unpacking process is started with.
constexpr int kUnpackedFile = 0;
constexpr int kUnpackSocket = 1;

/// Comes before the elements, which follow only kElementsFollow.
enum class UnpackReply : std::int32_t { kElementsFollow, kDamaged, kTooLarge };

/// Reads exactly `count` bytes; returns false at the end of the file or socket.
inline bool read_fully(int file, std::byte* into, std::size_t count) {
  while (count > 0) {
    const ssize_t n = read(file, into, count);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    into += n;
    count -= static_cast<std::size_t>(n);
  }
  return true;
}

}  // namespace curlew
