// Frame numbers, 64 bits of them: the sequence grows, and last - first + 1 = arrived + lost.
#include <cstring>

#include "acquisition/frame_numbering.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  using namespace curlew;
  if (size < 1) return 0;
  FrameNumbering numbering((bytes[0] & 1U) != 0);
  std::int64_t arrived = 0;
  std::int64_t lost = 0;
  std::int64_t last = -1;
  bool numbered = false;
  for (std::size_t at = 1; at + 9 <= size; at += 9) {
    ++arrived;
    if (bytes[at] % 8U == 0) {
      numbering.unnumbered();
      continue;
    }
    if (bytes[at] % 8U == 1) numbering.restart();
    std::uint64_t id = 0;
    std::memcpy(&id, bytes + at + 1, sizeof(id));
    const auto arrival = numbering.numbered(id);
    if ((numbered && arrival.sequence <= last) || arrival.lost < 0) __builtin_trap();
    numbered = true;
    last = arrival.sequence;
    lost += arrival.lost;
  }
  if (numbered && numbering.last() - numbering.first() + 1 != arrived + lost) __builtin_trap();
  return 0;
}
