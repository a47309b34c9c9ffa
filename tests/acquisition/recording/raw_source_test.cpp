// Files that hold pixels and nothing else.
#include "acquisition/recording/raw_source.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "core/error.h"
#include "tests/support/failure_text.h"
#include "tests/support/numbered_frames.h"
#include "tests/support/scratch_directory.h"

namespace curlew {
namespace {

constexpr int kRawRows = 4;
constexpr int kRawCols = 5;

/// Returns the pixels of numbered frames, in this byte order.
std::string pixels(std::int64_t first, std::int64_t frames, RawPixel type) {
  std::string bytes;
  for (std::int64_t frame = first; frame < first + frames; ++frame)
    for (std::size_t k = 0; k < kRawRows * kRawCols; ++k) {
      const std::uint16_t value = numbered_pixel(frame, k);
      const auto low = static_cast<char>(value & 0xFFU);
      const auto high = static_cast<char>(value >> 8U);
      if (type == RawPixel::kU16LittleEndian) bytes += low;
      bytes += high;
      if (type == RawPixel::kU16BigEndian) bytes += low;
    }
  return bytes;
}

TEST(RawSources, EveryTypeIsReadAsItIs) {
  for (const RawPixel type : {RawPixel::kU8, RawPixel::kU16LittleEndian, RawPixel::kU16BigEndian}) {
    const ScratchDirectory scratch;
    write_bytes(scratch / "a.raw", std::string(13, 'h') + pixels(0, 3, type));
    write_bytes(scratch / "b.raw", std::string(13, 'h') + pixels(3, 2, type));
    RawSource source({scratch / "a.raw", scratch / "b.raw"}, {kRawRows, kRawCols, type, 13});
    EXPECT_EQ(source.frame_count(), 5);
    FrameBuffer frame(source.format());
    for (std::int64_t i = 0; i < 5; ++i) {
      ASSERT_EQ(source.next(frame), Delivery::kFrame);
      EXPECT_TRUE(is_numbered(frame, i)) << i;
      EXPECT_EQ(frame.header.sequence, i);
      EXPECT_EQ(frame.header.received_ns, 0);
    }
    EXPECT_EQ(source.next(frame), Delivery::kEnd);
  }
}

TEST(RawSources, AFileThatIsCutWhileItIsReadIsRefused) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "a.raw";
  write_bytes(path, pixels(0, 3, RawPixel::kU8));
  RawSource source({path}, {kRawRows, kRawCols, RawPixel::kU8, 0});
  FrameBuffer frame(source.format());
  std::filesystem::resize_file(path, 30);
  EXPECT_EQ(source.next(frame), Delivery::kFrame);
  EXPECT_EQ(failure_text([&] { source.next(frame); }), path + " cannot be read to its end");
}

TEST(RawSources, ALengthThatIsNotOfWholeFramesIsRefused) {
  const ScratchDirectory scratch;
  write_bytes(scratch / "a.raw", std::string(41, ' '));
  const auto refusal = [&](const std::string& name, std::int64_t header) {
    return failure_text([&] {
      RawSource source({scratch / name}, {kRawRows, kRawCols, RawPixel::kU16LittleEndian, header});
    });
  };
  EXPECT_NE(
      refusal("a.raw", 0).find("has 41 bytes, which is no header of 0 and whole frames of 40"),
      std::string::npos);
  EXPECT_EQ(refusal("a.raw", 1), "");
  EXPECT_NE(refusal("a.raw", 41).find("whole frames"), std::string::npos);
  EXPECT_NE(refusal("missing.raw", 0).find("missing.raw"), std::string::npos);
  EXPECT_THROW(RawSource({scratch / "a.raw"}, {0, 5, RawPixel::kU8, 0}), UsageError);
  EXPECT_THROW(RawSource({scratch / "a.raw"}, {4, 10, RawPixel::kU8, -39}), UsageError);
}

}  // namespace
}  // namespace curlew
