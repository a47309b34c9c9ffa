// How GenICam cameras put pixels into bytes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "core/frame.h"

namespace curlew {

enum class Packing {
  kNone,       ///< a byte a pixel, or two, little endian
  kBitStream,  ///< Mono10p, Mono12p: pixels follow each other bit by bit, lowest bit first
  kGigE,       ///< Mono10Packed, Mono12Packed: two pixels in three bytes, GigE Vision's older way
};

struct PixelCoding {
  const char* name;    ///< as GenICam calls it
  std::uint32_t code;  ///< as the pixel format naming convention numbers it
  int bits;            ///< that carry the value
  Packing packing;

  PixelType type() const { return bits == 8 ? PixelType::kU8 : PixelType::kU16; }
  /// Bytes that `pixels` of them take, one after the other.
  std::size_t bytes(std::size_t pixels) const;
};

/// nullptr for a code we do not read.
const PixelCoding* find_pixel_coding(std::uint32_t code);

/// The names of all we read, with commas between.
std::string known_pixel_codings();

/// Unpacks `pixels` of a packed coding; from: coding.bytes(pixels) bytes.
void unpack_pixels(const PixelCoding& coding, const std::byte* from, std::size_t pixels,
                   std::uint16_t* to) noexcept;

}  // namespace curlew
