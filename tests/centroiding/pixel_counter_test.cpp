// Marked pixels are counted as one would by hand, in any rectangle.
#include "centroiding/pixel_counter.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <random>

namespace curlew {
namespace {

TEST(PixelCounter, CountsWhatAPlainLoopCounts) {
  constexpr std::uint64_t kCounterSeed = 20261130;
  SCOPED_TRACE(kCounterSeed);
  std::mt19937_64 random(kCounterSeed);
  constexpr int kRows = 53, kCols = 71;  // no multiples of a tile
  PixelCounter counter(kRows, kCols);
  Image<int> marked(kRows, kCols);
  for (int i = 0; i < 400; ++i) {
    const int row = static_cast<int>(random() % kRows), col = static_cast<int>(random() % kCols);
    counter.mark(row, col);
    marked(row, col) = 1;
  }
  for (int i = 0; i < 3000; ++i) {
    const int x0 = static_cast<int>(random() % kCols), y0 = static_cast<int>(random() % kRows);
    const int w = 1 + static_cast<int>(random() % static_cast<std::uint64_t>(kCols - x0));
    const int h = 1 + static_cast<int>(random() % static_cast<std::uint64_t>(kRows - y0));
    int expected = 0;
    for (int y = y0; y < y0 + h; ++y)
      for (int x = x0; x < x0 + w; ++x) expected += marked(y, x);
    ASSERT_EQ(counter.count(x0, y0, w, h), expected) << w << "x" << h << " at " << x0 << "," << y0;
  }
}

TEST(PixelCounter, FullTilesCountEveryPixelOnce) {
  PixelCounter counter(24, 24);
  for (int y = 0; y < 24; ++y)
    for (int x = 0; x < 24; ++x) counter.mark(y, x);
  EXPECT_EQ(counter.count(0, 0, 24, 24), 576);
  EXPECT_EQ(counter.count(7, 7, 2, 2), 4);
  EXPECT_EQ(counter.count(23, 23, 1, 1), 1);
  EXPECT_EQ(counter.count(8, 0, 8, 24), 192);
}

}  // namespace
}  // namespace curlew
