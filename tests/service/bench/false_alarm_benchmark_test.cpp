// The stated rate of the whitened detector holds for simulated photons, and it never allocates.
#include "service/bench/false_alarm_benchmark.h"

#include <gtest/gtest.h>

#include <cmath>

#include "detect/circulation.h"
#include "detect/whitened/whitened_finder.h"
#include "tests/support/allocation_counter.h"

namespace curlew {
namespace {

TEST(FalseAlarmBenchmark, WhitenedAlarmsAreAsStatedAtTwoFluxes) {
  FalseAlarmOptions options;
  options.photons = {1000.0, 200.0};
  options.rates = {1.0, 0.2};
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__) || !defined(NDEBUG)
  options.frames = 200;
#else
  options.frames = 2500;
#endif
  SCOPED_TRACE(options.seed);
  int checked = 0;
  for (const FalseAlarmCount& count : count_false_alarms(options, [] {})) {
    SCOPED_TRACE(::testing::Message() << count.detector << ", " << count.photons << " photons, "
                                      << count.rate << " a frame");
    // The promise is ±20 %, to which three standard deviations of the count are added.
    const double slack = 0.20 + 3.0 / std::sqrt(count.rate * static_cast<double>(count.frames));
    if (count.detector == "whitened" || count.detector == "circulation") {
      EXPECT_NEAR(count.ratio(), 1.0, slack);
      EXPECT_LE(count.ratio_low(), count.ratio());
      EXPECT_GE(count.ratio_high(), count.ratio());
      ++checked;
    } else {
      EXPECT_LT(count.ratio(), 1.0 + slack) << "a least probability can only lower the rate";
    }
  }
  EXPECT_EQ(checked, 8);
}

TEST(FalseAlarmBenchmark, IntervalIsThatOfAPoissonCount) {
  // The exact means for which 10 is the upper and the lower 2.5 % point are 4.795 and 18.390.
  FalseAlarmCount count;
  count.rate = 1.0;
  count.frames = 1;
  count.alarms = 10;
  EXPECT_NEAR(count.ratio_low(), 4.795, 0.02);
  EXPECT_NEAR(count.ratio_high(), 18.390, 0.02);
  count.alarms = 0;
  EXPECT_EQ(count.ratio_low(), 0.0);
  EXPECT_NEAR(count.ratio_high(), 3.689, 0.05);
}

TEST(WhitenedFinder, NeverAllocates) {
  if (!kCountsAllocations) GTEST_SKIP() << "the sanitizer owns malloc";
  constexpr int kSize = 12;
  SlopeField slopes(kSize, kSize);
  slopes.valid.fill(1);
  slopes.variance_x.fill(0.01F);
  slopes.variance_y.fill(0.01F);
  slopes.x(4, 4) = slopes.x(4, 5) = slopes.y(4, 5) = slopes.y(5, 5) = 1.1F;
  slopes.x(5, 5) = slopes.x(5, 4) = slopes.y(5, 4) = slopes.y(4, 4) = -1.1F;
  const Image<float> flux(kSize, kSize, 100.0F);
  CirculationMap map(kSize, kSize);
  circulate(slopes, map);
  const WhitenedPlan plan({}, slopes.valid, 16);
  WhitenedWorkspace workspace(plan);
  VortexList vortices(plan.capacity());
  const long allocated = allocations_of_this_thread(
      [&] { find_whitened_vortices(plan, slopes, flux, map, workspace, vortices); });
  EXPECT_EQ(allocated, 0);
  EXPECT_FALSE(vortices.empty()) << "the finder must have found something";
}

}  // namespace
}  // namespace curlew
