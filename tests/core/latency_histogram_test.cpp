#include "core/latency_histogram.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <vector>

namespace curlew {
namespace {

TEST(LatencyHistogram, PercentilesAreRightWithinABucket) {
  std::mt19937_64 random(7201);
  SCOPED_TRACE("seed 7201");
  std::lognormal_distribution<double> duration(10.0, 2.0);
  LatencyHistogram histogram;
  std::vector<std::int64_t> all;
  for (int i = 0; i < 20000; ++i) {
    all.push_back(static_cast<std::int64_t>(duration(random)));
    histogram.record(all.back());
  }
  std::sort(all.begin(), all.end());
  for (const double p : {0.0, 0.5, 0.9, 0.99, 0.999, 1.0}) {
    const auto rank = static_cast<std::size_t>(
        std::max(0.0, std::ceil(p * static_cast<double>(all.size())) - 1.0));
    const auto exact = static_cast<double>(all[rank]);
    const auto reported = static_cast<double>(histogram.percentile_ns(p));
    EXPECT_GE(reported, exact);
    EXPECT_LE(reported, exact * (1.0 + 1.0 / 64.0) + 1.0);  // This is the width of a bucket.
  }
  EXPECT_EQ(histogram.max_ns(), all.back());
  EXPECT_EQ(histogram.percentile_ns(1.0), all.back());
}

TEST(LatencyHistogram, SmallHugeAndNegativeDurations) {
  LatencyHistogram histogram;
  EXPECT_EQ(histogram.percentile_ns(0.5), 0);
  histogram.record(-5);  // A clock that was set back counts as no time.
  histogram.record(127);
  EXPECT_EQ(histogram.percentile_ns(0.5), 0);
  EXPECT_EQ(histogram.percentile_ns(1.0), 127);
  const std::int64_t weeks = 2'000'000'000'000'000;
  histogram.record(weeks);
  EXPECT_EQ(histogram.max_ns(), weeks);
  EXPECT_EQ(histogram.count(), 3U);
}

}  // namespace
}  // namespace curlew
