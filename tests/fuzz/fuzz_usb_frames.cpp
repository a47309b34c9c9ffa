// Plain USB cameras: the first bytes choose the layout and how the rest is cut into packets. Every
// frame that was begun is in one column of the books.
#include <algorithm>
#include <span>

#include "acquisition/usb/usb_frame_assembler.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  using namespace curlew;
  if (size < 2) return 0;
  UsbLayout layout;
  layout.rows = 3;
  layout.cols = 5;
  layout.bits = (bytes[0] & 1U) != 0 ? 8 : 12;
  layout.header_bytes = 8;
  layout.trailer_bytes = (bytes[0] & 2U) != 0 ? 3 : 0;
  if ((bytes[0] & 4U) != 0) layout.sync = "a55a";
  layout.sequence_offset = (bytes[0] & 8U) != 0 ? 4 : -1;
  const bool short_packets = (bytes[0] & 16U) != 0;
  FrameBuffer frame(usb_frame_format(layout));
  std::int64_t delivered = 0;
  UsbFrameAssembler assembler(
      layout, [&] { return &frame; },
      [&](FrameBuffer* whole) {
        ++delivered;
        return whole;
      });
  const std::size_t packet = 1U + bytes[1] % 64U;
  std::span<const std::uint8_t> rest(bytes + 2, size - 2);
  while (!rest.empty()) {
    const auto next = rest.first(std::min(packet, rest.size()));
    assembler.feed(std::as_bytes(next), short_packets && (next.back() & 3U) == 0, {});
    rest = rest.subspan(next.size());
  }
  assembler.end();
  if (assembler.counts().delivered != delivered || assembler.counts().dropped() < 0)
    __builtin_trap();
  return 0;
}
