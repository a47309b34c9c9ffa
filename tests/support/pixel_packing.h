// This packs pixels as GenICam cameras do, bit by bit, to check the fast unpackers against.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "acquisition/aravis/aravis_pixels.h"

namespace curlew {

inline std::vector<std::uint8_t> packed(const PixelCoding& coding,
                                        const std::vector<std::uint16_t>& values) {
  std::vector<std::uint8_t> bytes(coding.bytes(values.size()));
  const auto set = [&](std::size_t bit, unsigned value) {
    bytes[bit / 8] = static_cast<std::uint8_t>(bytes[bit / 8] | (value & 1U) << bit % 8);
  };
  for (std::size_t i = 0; i < values.size(); ++i) {
    for (int b = 0; b < coding.bits; ++b) {
      const unsigned value = static_cast<unsigned>(values[i]) >> b;
      const auto bit = static_cast<std::size_t>(b);
      const auto bits = static_cast<std::size_t>(coding.bits);
      if (coding.packing == Packing::kBitStream) {
        set(i * bits + bit, value);
      } else if (coding.packing == Packing::kGigE) {
        // A pair takes three bytes: the high bits of the first, the low bits of both, the high bits
        // of the second.
        const std::size_t pair = i / 2 * 24;
        const std::size_t low = bits - 8;
        if (bit < low)
          set(pair + 8 + i % 2 * 4 + bit, value);
        else
          set(pair + i % 2 * 16 + bit - low, value);
      } else {
        set(i * (coding.bits == 8 ? 8 : 16) + bit, value);
      }
    }
  }
  return bytes;
}

}  // namespace curlew
