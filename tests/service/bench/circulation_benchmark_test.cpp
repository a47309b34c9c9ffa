#include "service/bench/circulation_benchmark.h"

#include <gtest/gtest.h>

namespace curlew {
namespace {

TEST(CirculationBenchmark, FindsWhatWasPutIn) {
  EXPECT_LE(time_circulation(24, 24, 0, 1).found, 1U);
  const CirculationBenchmark one = time_circulation(24, 24, 1, 1);
  EXPECT_EQ(one.found, 1U);
  EXPECT_GT(one.both.median_us, 0.0);
}

}  // namespace
}  // namespace curlew
