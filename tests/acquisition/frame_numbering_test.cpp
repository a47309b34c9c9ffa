#include "acquisition/frame_numbering.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <random>

namespace curlew {
namespace {

TEST(FrameNumbering, FirstNumberIsTheSequence) {
  FrameNumbering numbering(true);
  const auto first = numbering.numbered(65400);
  EXPECT_EQ(first.sequence, 65400);
  EXPECT_TRUE(first.renumbered);
  EXPECT_EQ(first.lost, 0);
  EXPECT_EQ(numbering.first(), 65400);
  EXPECT_EQ(numbering.last(), 65400);
}

TEST(FrameNumbering, WrapSkipsZeroAndLosesNothing) {
  FrameNumbering numbering(true);
  numbering.numbered(65534);
  EXPECT_EQ(numbering.numbered(65535).sequence, 65535);
  const auto wrapped = numbering.numbered(1);
  EXPECT_EQ(wrapped.sequence, 65536);
  EXPECT_EQ(wrapped.lost, 0);
  EXPECT_FALSE(wrapped.renumbered);
}

TEST(FrameNumbering, GapAcrossTheWrapIsCounted) {
  FrameNumbering numbering(true);
  numbering.numbered(65530);
  const auto next = numbering.numbered(3);  // 65531 to 65535, 1 and 2 are missing.
  EXPECT_EQ(next.lost, 7);
  EXPECT_EQ(next.sequence, 65538);
}

TEST(FrameNumbering, ManyLapsKeepCount) {
  FrameNumbering numbering(true);
  std::int64_t sequence = 0;
  for (std::int64_t i = 0; i < 200000; ++i)
    sequence = numbering.numbered(static_cast<std::uint64_t>(i % 65535 + 1)).sequence;
  EXPECT_EQ(sequence, 200000);
}

TEST(FrameNumbering, LargeNumbersCountIn64Bits) {
  FrameNumbering numbering(true);
  numbering.numbered(65535);
  const auto next = numbering.numbered(65536);
  EXPECT_EQ(next.sequence, 65536);
  EXPECT_EQ(next.lost, 0);
  EXPECT_EQ(numbering.numbered(165536).lost, 99999);
}

TEST(FrameNumbering, UsbCountsFromZero) {
  FrameNumbering numbering(false);
  EXPECT_EQ(numbering.numbered(0).sequence, 0);
  EXPECT_EQ(numbering.numbered(1).sequence, 1);
  EXPECT_EQ(numbering.numbered(70000).lost, 69998);
}

TEST(FrameNumbering, NumbersThatGoBackBeginAnew) {
  FrameNumbering numbering(true);
  numbering.numbered(300);
  const auto anew = numbering.numbered(1);
  EXPECT_TRUE(anew.renumbered);
  EXPECT_EQ(anew.lost, 0);
  EXPECT_EQ(anew.sequence, 301);
}

TEST(FrameNumbering, RestartedStreamGoesOnFromTheLast) {
  FrameNumbering numbering(true);
  numbering.numbered(10);
  numbering.unnumbered();
  numbering.restart();
  const auto next = numbering.numbered(5000);
  EXPECT_TRUE(next.renumbered);
  EXPECT_EQ(next.lost, 0);
  EXPECT_EQ(next.sequence, 12);
}

TEST(FrameNumbering, FrameWithoutNumberFillsAGap) {
  FrameNumbering numbering(true);
  numbering.numbered(10);
  numbering.unnumbered();
  const auto next = numbering.numbered(13);  // One of 11 and 12 came without its number.
  EXPECT_EQ(next.lost, 1);
  EXPECT_EQ(next.sequence, 13);
}

TEST(FrameNumbering, FramesWithoutNumberBeforeTheFirst) {
  FrameNumbering numbering(true);
  numbering.unnumbered();
  numbering.unnumbered();
  EXPECT_EQ(numbering.last() - numbering.first() + 1, 2);
  EXPECT_EQ(numbering.numbered(100).sequence, 100);
  EXPECT_EQ(numbering.first(), 98);
}

// Whatever arrives, the numbers from first to last are those of frames that arrived and those that
// were lost, and sequences grow.
TEST(FrameNumbering, EveryNumberIsInOnePlace) {
  for (const bool narrow : {true, false}) {
    for (unsigned seed = 1; seed <= 20; ++seed) {
      SCOPED_TRACE(testing::Message() << "seed " << seed << (narrow ? ", 16 bits" : ", 64 bits"));
      std::mt19937 random(seed);
      const auto one_in = [&](unsigned n) { return random() % n == 0; };
      FrameNumbering numbering(narrow);
      std::uint64_t id = 1 + random() % 65535;
      std::int64_t arrived = 0;
      std::int64_t lost = 0;
      std::int64_t last_sequence = -1;
      for (int i = 0; i < 5000; ++i) {
        id = id + 1 + (one_in(50) ? random() % 300 : 0);
        if (one_in(1000)) id = 1 + random() % 65535;
        if (narrow) id = (id - 1) % 65535 + 1;
        if (one_in(300)) numbering.restart();
        ++arrived;
        if (one_in(20)) {
          numbering.unnumbered();
          continue;
        }
        const auto arrival = numbering.numbered(id);
        EXPECT_GT(arrival.sequence, last_sequence);
        EXPECT_GE(arrival.lost, 0);
        last_sequence = arrival.sequence;
        lost += arrival.lost;
        ASSERT_EQ(numbering.last() - numbering.first() + 1, arrived + lost);
      }
      EXPECT_EQ(numbering.last() - numbering.first() + 1, arrived + lost);
    }
  }
}

// Numbers at the ends of 64 bits begin anew instead of overflowing.
TEST(FrameNumbering, NumbersThatNoCameraCountsBeginAnew) {
  constexpr std::uint64_t kHuge = ~std::uint64_t{0};
  FrameNumbering numbering(false);
  EXPECT_EQ(numbering.numbered(kHuge).sequence, 0);
  const auto leap = numbering.numbered(kHuge / 2 - 1);
  EXPECT_TRUE(leap.renumbered);
  EXPECT_EQ(leap.sequence, 1);
  EXPECT_EQ(leap.lost, 0);

  FrameNumbering near_end(false);
  near_end.numbered((std::uint64_t{1} << 62) - 1);
  EXPECT_FALSE(near_end.numbered(std::uint64_t{1} << 62).renumbered);
  EXPECT_TRUE(near_end.numbered((std::uint64_t{1} << 62) + 5).renumbered);

  FrameNumbering wraps(false);
  std::int64_t last = -1;
  for (const std::uint64_t id :
       {kHuge, kHuge >> 1U, std::uint64_t{5}, kHuge - 3, kHuge, 0UL, 1UL}) {
    const auto arrival = wraps.numbered(id);
    EXPECT_GT(arrival.sequence, last);
    EXPECT_GE(arrival.lost, 0);
    last = arrival.sequence;
  }
}

}  // namespace
}  // namespace curlew
