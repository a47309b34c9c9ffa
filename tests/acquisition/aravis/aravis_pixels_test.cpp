#include "acquisition/aravis/aravis_pixels.h"

#include <gtest/gtest.h>

#include <random>
#include <vector>

#include "tests/support/pixel_packing.h"

namespace curlew {
namespace {

using Bytes = std::vector<std::uint8_t>;

const PixelCoding& coding(std::uint32_t code) { return *find_pixel_coding(code); }
constexpr std::uint32_t kMono10p = 0x010A0046;
constexpr std::uint32_t kMono12p = 0x010C0047;
constexpr std::uint32_t kMono10Packed = 0x010C0004;
constexpr std::uint32_t kMono12Packed = 0x010C0006;

std::vector<std::uint16_t> unpacked(std::uint32_t code, const Bytes& bytes, std::size_t pixels) {
  EXPECT_EQ(coding(code).bytes(pixels), bytes.size());
  std::vector<std::uint16_t> values(pixels, 0xFFFF);
  unpack_pixels(coding(code), reinterpret_cast<const std::byte*>(bytes.data()), pixels,
                values.data());
  return values;
}

using Values = std::vector<std::uint16_t>;

// The bits are as the pixel format naming convention and the GigE Vision standard draw them.
TEST(AravisPixels, Mono12p) {
  EXPECT_EQ(unpacked(kMono12p, {0x21, 0x43, 0x65}, 2), (Values{0x321, 0x654}));
  EXPECT_EQ(unpacked(kMono12p, {0x21, 0x43, 0x65, 0xBC, 0x0A}, 3), (Values{0x321, 0x654, 0xABC}));
}

TEST(AravisPixels, Mono12Packed) {
  EXPECT_EQ(unpacked(kMono12Packed, {0x32, 0x41, 0x65}, 2), (Values{0x321, 0x654}));
  EXPECT_EQ(unpacked(kMono12Packed, {0x32, 0x41, 0x65, 0xAB, 0x0C}, 3),
            (Values{0x321, 0x654, 0xABC}));
}

TEST(AravisPixels, Mono10p) {
  // The pixels are 0b11'1111'1111, 0, 0b10'0000'0001 and 0b01'1111'1110, from the lowest bit up.
  EXPECT_EQ(unpacked(kMono10p, {0xFF, 0x03, 0x10, 0xA0, 0x7F}, 4),
            (Values{0x3FF, 0x000, 0x201, 0x1FE}));
  EXPECT_EQ(unpacked(kMono10p, {0xFF, 0x03}, 1), (Values{0x3FF}));
}

TEST(AravisPixels, Mono10Packed) {
  EXPECT_EQ(unpacked(kMono10Packed, {0xFF, 0x13, 0x80}, 2), (Values{0x3FF, 0x201}));
  EXPECT_EQ(unpacked(kMono10Packed, {0x80, 0x01}, 1), (Values{0x201}));
}

TEST(AravisPixels, UnpackingUndoesPackingForAnyNumberOfPixels) {
  constexpr unsigned seed = 7;
  std::mt19937 random(seed);
  for (const std::uint32_t code : {kMono10p, kMono12p, kMono10Packed, kMono12Packed}) {
    for (std::size_t pixels = 1; pixels < 40; ++pixels) {
      SCOPED_TRACE(testing::Message() << coding(code).name << ", " << pixels << " pixels");
      Values values(pixels);
      for (auto& value : values)
        value = static_cast<std::uint16_t>(random() & ((1U << coding(code).bits) - 1));
      EXPECT_EQ(unpacked(code, packed(coding(code), values), pixels), values);
    }
  }
}

TEST(AravisPixels, UnknownCodesAreNotFound) {
  EXPECT_EQ(find_pixel_coding(0x02180014), nullptr);  // This is RGB8.
  EXPECT_EQ(find_pixel_coding(0), nullptr);
}

}  // namespace
}  // namespace curlew
