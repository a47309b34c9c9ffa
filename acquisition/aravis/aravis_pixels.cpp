#include "acquisition/aravis/aravis_pixels.h"

#include <array>

namespace curlew {
namespace {

constexpr std::array<PixelCoding, 9> kCodings{{
    {"Mono8", 0x01080001, 8, Packing::kNone},
    {"Mono10", 0x01100003, 10, Packing::kNone},
    {"Mono10p", 0x010A0046, 10, Packing::kBitStream},
    {"Mono10Packed", 0x010C0004, 10, Packing::kGigE},
    {"Mono12", 0x01100005, 12, Packing::kNone},
    {"Mono12p", 0x010C0047, 12, Packing::kBitStream},
    {"Mono12Packed", 0x010C0006, 12, Packing::kGigE},
    {"Mono14", 0x01100025, 14, Packing::kNone},
    {"Mono16", 0x01100007, 16, Packing::kNone},
}};

std::uint16_t u16(unsigned value) { return static_cast<std::uint16_t>(value); }

/// Unpacks the last pixels of a bit stream, which do not fill a group.
void unpack_bits(int bits, const std::uint8_t* from, std::size_t pixels, std::uint16_t* to) {
  unsigned pool = 0;
  int held = 0;
  for (std::size_t i = 0; i < pixels; ++i) {
    for (; held < bits; held += 8) pool |= static_cast<unsigned>(*from++) << held;
    to[i] = u16(pool & ((1U << bits) - 1));
    pool >>= bits;
    held -= bits;
  }
}

void unpack_10p(const std::uint8_t* from, std::size_t pixels, std::uint16_t* to) {
  std::size_t i = 0;
  for (; i + 4 <= pixels; i += 4, from += 5) {
    to[i] = u16(from[0] | (from[1] & 0x03U) << 8);
    to[i + 1] = u16(from[1] >> 2 | (from[2] & 0x0FU) << 6);
    to[i + 2] = u16(from[2] >> 4 | (from[3] & 0x3FU) << 4);
    to[i + 3] = u16(from[3] >> 6 | static_cast<unsigned>(from[4]) << 2);
  }
  unpack_bits(10, from, pixels - i, to + i);
}

void unpack_12p(const std::uint8_t* from, std::size_t pixels, std::uint16_t* to) {
  std::size_t i = 0;
  for (; i + 2 <= pixels; i += 2, from += 3) {
    to[i] = u16(from[0] | (from[1] & 0x0FU) << 8);
    to[i + 1] = u16(from[1] >> 4 | static_cast<unsigned>(from[2]) << 4);
  }
  unpack_bits(12, from, pixels - i, to + i);
}

/// Unpacks two pixels from three bytes. The middle byte holds the low bits of both, those of the
/// first pixel in its lower half.
template <unsigned kLowBits>
void unpack_gige(const std::uint8_t* from, std::size_t pixels, std::uint16_t* to) {
  constexpr unsigned mask = (1U << kLowBits) - 1;
  std::size_t i = 0;
  for (; i + 2 <= pixels; i += 2, from += 3) {
    to[i] = u16(static_cast<unsigned>(from[0]) << kLowBits | (from[1] & mask));
    to[i + 1] = u16(static_cast<unsigned>(from[2]) << kLowBits | (from[1] >> 4 & mask));
  }
  if (i < pixels) to[i] = u16(static_cast<unsigned>(from[0]) << kLowBits | (from[1] & mask));
}

}  // namespace

std::size_t PixelCoding::bytes(std::size_t pixels) const {
  switch (packing) {
    case Packing::kNone:
      return pixels * static_cast<std::size_t>(type());
    case Packing::kBitStream:
      return (pixels * static_cast<std::size_t>(bits) + 7) / 8;
    case Packing::kGigE:
      return (pixels * 12 + 7) / 8;
  }
  return 0;
}

const PixelCoding* find_pixel_coding(std::uint32_t code) {
  for (const auto& coding : kCodings)
    if (coding.code == code) return &coding;
  return nullptr;
}

std::string known_pixel_codings() {
  std::string names;
  for (const auto& coding : kCodings) {
    if (!names.empty()) names += ", ";
    names += coding.name;
  }
  return names;
}

void unpack_pixels(const PixelCoding& coding, const std::byte* from, std::size_t pixels,
                   std::uint16_t* to) noexcept {
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(from);
  if (coding.packing == Packing::kBitStream)
    coding.bits == 10 ? unpack_10p(bytes, pixels, to) : unpack_12p(bytes, pixels, to);
  else if (coding.packing == Packing::kGigE)
    coding.bits == 10 ? unpack_gige<2>(bytes, pixels, to) : unpack_gige<4>(bytes, pixels, to);
}

}  // namespace curlew
