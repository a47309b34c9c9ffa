// This tells how GenICam cameras put pixels into bytes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "core/frame.h"

namespace curlew {

enum class Packing {
  kNone,       ///< one byte per pixel, or two, little endian
  kBitStream,  ///< Mono10p, Mono12p: pixels follow each other bit by bit, lowest bit first
  kGigE,       ///< Mono10Packed, Mono12Packed: two pixels in three bytes, GigE Vision's older way
};

struct PixelCoding {
  const char* name;    ///< GenICam's name for it
  std::uint32_t code;  ///< its number in the pixel format naming convention
  int bits;            ///< number of bits that carry the value
  Packing packing;

  PixelType type() const { return bits == 8 ? PixelType::kU8 : PixelType::kU16; }
  /// Returns how many bytes `pixels` of them take, one after the other.
  std::size_t bytes(std::size_t pixels) const;
};

/// Returns the coding with this code, nullptr if we do not read it.
const PixelCoding* find_pixel_coding(std::uint32_t code);

/// Returns the names of all codings that we read, with commas between them.
std::string known_pixel_codings();

/// Unpacks `pixels` pixels of a packed coding. from: coding.bytes(pixels) bytes.
void unpack_pixels(const PixelCoding& coding, const std::byte* from, std::size_t pixels,
                   std::uint16_t* to) noexcept;

}  // namespace curlew
