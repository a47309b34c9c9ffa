#include "core/to_int.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace curlew {
namespace {

TEST(ToInt, RoundsAsTheMathematicalLibraryDoes) {
  constexpr unsigned kToIntSeed = 7;
  std::mt19937 random(kToIntSeed);
  std::uniform_real_distribution<double> of_thousands(-5000.0, 5000.0);
  for (int i = 0; i < 20000; ++i) {
    // Whole numbers, halves and quarters are among them.
    const double x = i % 2 == 0 ? of_thousands(random) : std::round(of_thousands(random)) / 4.0;
    ASSERT_EQ(round_to_int(x), std::lround(x)) << x << ", seed " << kToIntSeed;
    ASSERT_EQ(floor_to_int(x), static_cast<int>(std::floor(x))) << x;
    ASSERT_EQ(ceil_to_int(x), static_cast<int>(std::ceil(x))) << x;
  }
}

}  // namespace
}  // namespace curlew
