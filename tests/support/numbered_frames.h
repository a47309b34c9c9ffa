// This makes frames whose pixels follow from their number, so that any reader can tell whether they
// are right. tests/support/astropy_peer.py knows the formula too.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>

#include "core/frame.h"

namespace curlew {

inline std::uint16_t numbered_pixel(std::int64_t sequence, std::size_t k) {
  return static_cast<std::uint16_t>(static_cast<std::uint64_t>(sequence) * 7919U + k * 31U);
}

/// Fills in frame number `sequence` of a camera at 1 kHz.
inline void fill_numbered(FrameBuffer& frame, std::int64_t sequence) {
  const std::size_t n = frame.format().pixels();
  if (frame.format().pixel_type == PixelType::kU16) {
    auto* pixels = reinterpret_cast<std::uint16_t*>(frame.data());
    for (std::size_t k = 0; k < n; ++k) pixels[k] = numbered_pixel(sequence, k);
  } else {
    for (std::size_t k = 0; k < n; ++k) {
      frame.data()[k] = static_cast<std::byte>(numbered_pixel(sequence, k) >> 8U);
    }
  }
  frame.header.sequence = sequence;
  frame.header.camera_ns = 5'000'000 + sequence * 1'000'000;
  frame.header.received_ns = 1'800'000'000'000'000'000 + sequence * 1'000'000;
  frame.header.received =
      std::chrono::steady_clock::time_point{} + std::chrono::milliseconds(sequence);
  frame.header.status = sequence % 10 == 3 ? kFrameLate : kFrameOk;
}

/// Says whether all pixels are those of frame number `sequence`.
inline bool is_numbered(FrameBuffer& frame, std::int64_t sequence) {
  const std::size_t n = frame.format().pixels();
  for (std::size_t k = 0; k < n; ++k) {
    const std::uint16_t expected = numbered_pixel(sequence, k);
    if (frame.format().pixel_type == PixelType::kU16
            ? reinterpret_cast<std::uint16_t*>(frame.data())[k] != expected
            : frame.data()[k] != static_cast<std::byte>(expected >> 8U)) {
      return false;
    }
  }
  return true;
}

}  // namespace curlew
