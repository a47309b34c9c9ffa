// The level and the noise between the spots are what was put there, whatever the spots do.
#include "centroiding/frame_level.h"

#include <gtest/gtest.h>

#include <cmath>

#include "acquisition/simulator/random_stream.h"
#include "centroiding/centroid.h"
#include "service/bench/bench_frames.h"

namespace curlew {
namespace {

constexpr std::uint64_t kSeed = 20261129;

/// A frame without spots whose pixels are given by a function of (x, y).
template <typename Value>
BenchFrame drawn(const BenchCase& which, Value value) {
  BenchFrame frame;
  frame.format.rows = which.rows * which.window_px;
  frame.format.cols = which.cols * which.window_px;
  frame.pixels = Image<std::uint16_t>(frame.format.rows, frame.format.cols);
  for (int y = 0; y < frame.format.rows; ++y)
    for (int x = 0; x < frame.format.cols; ++x)
      frame.pixels(y, x) = static_cast<std::uint16_t>(std::lround(value(x, y)));
  return frame;
}

FrameLevels measured(const Sensor& sensor, const BenchFrame& frame) {
  const LevelPlan plan(sensor, CentroidPlan(sensor, frame.format), {});
  FrameLevels levels(plan);
  measure_levels(plan, plan.pixels(), frame.view(), levels);
  return levels;
}

class Level : public ::testing::TestWithParam<BenchCase> {};
INSTANTIATE_TEST_SUITE_P(Pitches, Level,
                         ::testing::Values(BenchCase{12, 14, 6}, BenchCase{20, 20, 12},
                                           BenchCase{9, 7, 24}),
                         [](const auto& which) {
                           return std::to_string(which.param.window_px) + "px";
                         });

TEST_P(Level, IsThatOfTheFrameAndSoIsTheNoise) {
  const Sensor sensor = tiled_sensor(GetParam());
  RandomStream random(kSeed, 1);
  const BenchFrame frame = drawn(
      GetParam(), [&](int, int) { return kBenchBackgroundAdu + 35.0 + 7.0 * random.gaussian(); });
  const FrameLevels levels = measured(sensor, frame);
  double sum = 0.0;
  for (const float level : levels.level) sum += static_cast<double>(level);
  EXPECT_NEAR(sum / static_cast<double>(levels.level.size()), 35.0, 1.0);
  // 99 pixels are the fewest here: their rms scatters by 7 %.
  EXPECT_NEAR(levels.noise, 7.0F, 0.9F);
  EXPECT_FLOAT_EQ(levels.threshold, 4.0F * levels.noise) << "above the read noise of 3";
  EXPECT_FLOAT_EQ(levels.pixel_variance, levels.noise * levels.noise);
}

TEST_P(Level, OfAGradientIsTheGradientUpToTheRim) {
  const Sensor sensor = tiled_sensor(GetParam());
  const int pitch = GetParam().window_px;
  const BenchFrame frame = drawn(GetParam(), [&](int x, int y) { return 200.0 + 4.0 * x + y; });
  const FrameLevels levels = measured(sensor, frame);
  for (int r = 1; r + 1 < levels.level.rows(); ++r)
    for (int c = 1; c + 1 < levels.level.cols(); ++c)
      EXPECT_NEAR(levels.level(r, c),
                  100.0 + 4.0 * (pitch * (c + 0.5) - 0.5) + (pitch * (r + 0.5) - 0.5), 2.51)
          << "half a pixel of the gradient, " << r << ", " << c;
}

TEST_P(Level, NeitherSpotsNorHotPixelsMoveIt) {
  const Sensor sensor = tiled_sensor(GetParam());
  BenchFrame frame = make_bench_frame(GetParam(), BenchSlopes::kRandom, kSeed);
  RandomStream random(kSeed, 2);
  for (std::size_t i = 0; i < frame.pixels.size(); ++i)
    if (random.uniform() < 0.01) frame.pixels[i] = 60000;
  const FrameLevels levels = measured(sensor, frame);
  // Spots of σ = P/6 leave 3 % of their peaks at the corner when they come P/8 nearer on both axes.
  for (const float level : levels.level) EXPECT_NEAR(level, 0.0F, 120.0F);
  double sum = 0.0;
  for (const float level : levels.level) sum += static_cast<double>(level);
  EXPECT_NEAR(sum / static_cast<double>(levels.level.size()), 0.0, 15.0);
}

TEST(FrameLevel, CentroidsAreThoseOfAnyLevel) {
  const BenchCase which{16, 16, 12};
  const Sensor sensor = tiled_sensor(which);
  BenchFrame frame = make_bench_frame(which, BenchSlopes::kSmooth, kSeed);
  const CentroidPlan plan(sensor, frame.format);
  const LevelPlan level_plan(sensor, CentroidPlan(sensor, frame.format), {});
  FrameLevels levels(level_plan);
  Centroids low(16, 16), high(16, 16);
  measure_levels(level_plan, level_plan.pixels(), frame.view(), levels);
  find_centroids(plan, frame.view(), low, {&levels});
  for (std::uint16_t& count : frame.pixels) count = static_cast<std::uint16_t>(count + 500);
  measure_levels(level_plan, level_plan.pixels(), frame.view(), levels);
  find_centroids(plan, frame.view(), high, {&levels});
  for (std::size_t k = 0; k < low.state.size(); ++k) {
    ASSERT_EQ(low.state[k], high.state[k]) << k;
    EXPECT_NEAR(low.x_px[k], high.x_px[k], 2e-4F) << k;
    EXPECT_NEAR(low.y_px[k], high.y_px[k], 2e-4F) << k;
    EXPECT_NEAR(low.variance_x_px2[k], high.variance_x_px2[k], 1e-3F * low.variance_x_px2[k]);
  }
}

TEST(FrameLevel, NoiseFarBelowACountIsQuantisation) {
  const BenchCase which{20, 20, 12};
  const Sensor sensor = tiled_sensor(which);
  RandomStream random(kSeed, 3);
  const BenchFrame frame = drawn(which, [&](int, int) { return 100.5 + 0.2 * random.gaussian(); });
  // Half of the counts are 100 and half are 101: about a level of 100.5 their rms is .5.
  EXPECT_NEAR(measured(sensor, frame).noise, 0.5F, 0.1F);
}

TEST(FrameLevel, BadPixelsAreNotLookedAt) {
  const BenchCase which{10, 10, 10};
  Sensor sensor = tiled_sensor(which);
  sensor.bad_pixel = Image<std::uint8_t>(100, 100);
  BenchFrame frame = drawn(which, [](int, int) { return 130.0; });
  RandomStream random(kSeed, 4);
  for (std::size_t i = 0; i < frame.pixels.size(); ++i) {
    if (random.uniform() > 0.6) continue;
    sensor.bad_pixel[i] = 1;
    frame.pixels[i] = 65535;
  }
  const FrameLevels levels = measured(sensor, frame);
  for (const float level : levels.level) EXPECT_FLOAT_EQ(level, 30.0F);
}

}  // namespace
}  // namespace curlew
