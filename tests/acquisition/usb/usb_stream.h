// This makes what a plain USB camera sends, and keeps what comes of it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <initializer_list>
#include <memory>
#include <random>
#include <string>
#include <tuple>
#include <vector>

#include "acquisition/usb/usb_frame_assembler.h"

namespace curlew {

using Bytes = std::vector<std::uint8_t>;

/// Returns a layout of 12 × 20 pixels, a header of 16 bytes with sync a55a01ff and a frame number
/// at 8, and a trailer of 6.
inline UsbLayout stream_layout(int bits = 16, bool sync = true, bool numbered = true) {
  UsbLayout layout;
  layout.rows = 12;
  layout.cols = 20;
  layout.bits = bits;
  layout.header_bytes = 16;
  layout.trailer_bytes = 6;
  if (sync) layout.sync = "a55a01ff";
  if (numbered) layout.sequence_offset = 8;
  return layout;
}

/// Returns the pixels of frame `number`. Any two frames differ nearly everywhere.
inline Bytes stream_pixels(const UsbLayout& layout, std::uint32_t number) {
  Bytes pixels(usb_frame_format(layout).bytes());
  std::mt19937 random(number);
  for (std::uint8_t& byte : pixels) byte = static_cast<std::uint8_t>(random());
  return pixels;
}

inline Bytes stream_frame(const UsbLayout& layout, std::uint32_t number) {
  Bytes frame(static_cast<std::size_t>(layout.header_bytes), 0x11);
  for (std::size_t i = 0; 2 * i < layout.sync.size(); ++i) {
    frame[i] = static_cast<std::uint8_t>(std::stoi(layout.sync.substr(2 * i, 2), nullptr, 16));
  }
  if (layout.sequence_offset >= 0) {
    std::memcpy(frame.data() + layout.sequence_offset, &number, sizeof number);
  }
  const Bytes pixels = stream_pixels(layout, number);
  frame.insert(frame.end(), pixels.begin(), pixels.end());
  frame.insert(frame.end(), static_cast<std::size_t>(layout.trailer_bytes), 0x22);
  return frame;
}

/// Holds a frame as it was delivered.
struct Delivered {
  std::int64_t sequence = 0;
  bool renumbered = false;
  std::uint32_t status = 0;
  Bytes pixels;

  bool operator==(const Delivered&) const = default;
};

inline Delivered copy_of(const FrameBuffer& frame) {
  const auto* pixels = frame.view().data<std::uint8_t>();
  return {frame.header.sequence, frame.header.renumbered, frame.header.status,
          Bytes(pixels, pixels + frame.format().bytes())};
}

/// Keeps every frame of an assembler.
class Collector {
 public:
  explicit Collector(const UsbLayout& layout)
      : buffer_(usb_frame_format(layout)),
        assembler_(
            layout, [this] { return has_buffer ? &buffer_ : nullptr; },
            [this](FrameBuffer* frame) {
              frames.push_back(copy_of(*frame));
              return has_buffer ? frame : nullptr;
            }) {}

  void feed(const Bytes& bytes, bool ended_short = false) {
    assembler_.feed(std::as_bytes(std::span(bytes)), ended_short, {});
  }
  /// Feeds whole frames of stream_layout() with these numbers.
  void feed_numbered(std::initializer_list<std::uint32_t> numbers) {
    for (const std::uint32_t n : numbers) feed(stream_frame(stream_layout(), n), true);
  }
  UsbFrameAssembler& assembler() { return assembler_; }
  FrameCounts counts() const { return assembler_.counts(); }

  bool has_buffer = true;
  std::vector<Delivered> frames;

 private:
  FrameBuffer buffer_;
  UsbFrameAssembler assembler_;
};

}  // namespace curlew
