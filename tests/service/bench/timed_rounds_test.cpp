#include "service/bench/timed_rounds.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>

#include "service/bench/bench_timing.h"

namespace curlew {
namespace {

TEST(BenchTiming, QuantilesOfKnownValues) {
  const std::vector<double> values{5.0, 1.0, 4.0, 2.0, 3.0, 9.0, 7.0, 8.0, 6.0, 0.0};
  EXPECT_EQ(quantile(values, 0.0), 0.0);
  EXPECT_EQ(quantile(values, 0.1), 1.0);
  EXPECT_EQ(quantile(values, 0.5), 5.0);
  EXPECT_EQ(quantile(values, 0.9), 9.0);
  EXPECT_EQ(quantile(values, 1.0), 9.0);
  EXPECT_EQ(quantile({3.0}, 0.1), 3.0);
}

TEST(TimedRounds, RunsTakeTurnsAndPrepare) {
  std::string order;
  const std::vector<RoundTimes> times = time_in_turn(
      {{[&] { order += 'p'; }, [&] { order += 'a'; }}, {{}, [&] { order += 'b'; }}}, 4);
  ASSERT_EQ(times.size(), 2U);
  std::string expected;
  for (std::size_t round = 0; round < order.size() / 3; ++round) expected += "pab";
  EXPECT_EQ(order, expected);
  EXPECT_GE(order.size(), 3U * 4U);
  for (const RoundTimes& t : times) {
    EXPECT_LE(t.p10_us, t.median_us);
    EXPECT_LE(t.median_us, t.p90_us);
    EXPECT_EQ(times_json(t)["median_us"], t.median_us);
  }
}

}  // namespace
}  // namespace curlew
