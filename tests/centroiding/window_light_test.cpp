// The light of a window is what was put into it, whatever the threshold cuts off.
#include "centroiding/window_light.h"

#include <gtest/gtest.h>

#include <cstdint>

#include "centroiding/centroid.h"
#include "centroiding/frame_level.h"
#include "service/bench/bench_frames.h"

namespace curlew {
namespace {

constexpr BenchCase kCase{12, 14, 10};

/// Level, centroids and light of one frame.
struct Measured {
  explicit Measured(const Sensor& sensor, const BenchFrame& frame)
      : plan(sensor, frame.format),
        level_plan(sensor, plan, {}),
        levels(level_plan),
        centroids(kCase.rows, kCase.cols),
        light_adu(kCase.rows, kCase.cols),
        area_px(kCase.rows, kCase.cols) {
    measure_levels(level_plan, level_plan.pixels(), frame.view(), levels);
    find_centroids(plan, frame.view(), centroids, {.levels = &levels});
    sum_window_light(plan, frame.view(), centroids, &levels, light_adu, area_px);
  }

  CentroidPlan plan;
  LevelPlan level_plan;
  FrameLevels levels;
  Centroids centroids;
  Image<float> light_adu;
  Image<float> area_px;
};

double light_of(const BenchFrame& frame, int row, int col) {
  double sum = 0.0;
  for (int y = row * kCase.window_px; y < (row + 1) * kCase.window_px; ++y)
    for (int x = col * kCase.window_px; x < (col + 1) * kCase.window_px; ++x)
      sum += static_cast<double>(frame.pixels(y, x)) - kBenchBackgroundAdu;
  return sum;
}

TEST(WindowLight, IsTheSumOfItsPixelsAboveTheFramesLevel) {
  BenchFrame frame = make_bench_frame(kCase, BenchSlopes::kRandom, 7);
  for (std::size_t i = 0; i < frame.pixels.size(); ++i)
    frame.pixels[i] = static_cast<std::uint16_t>(frame.pixels[i] + 20);  // of sky
  const Measured measured(tiled_sensor(kCase), frame);
  for (int row = 0; row < kCase.rows; ++row)
    for (int col = 0; col < kCase.cols; ++col) {
      const double level = static_cast<double>(measured.levels.level(row, col));
      EXPECT_NEAR(level, 20.0, 15.0) << "the spots' light in the corners is little";
      const double light = light_of(frame, row, col) - 100.0 * level;
      EXPECT_NEAR(measured.light_adu(row, col), light, 1e-5 * light + 1.0) << row << ", " << col;
      EXPECT_EQ(measured.area_px(row, col), 100.0F);
      EXPECT_GT(measured.light_adu(row, col), measured.centroids.flux_adu(row, col));
    }
}

TEST(WindowLight, OfWindowsWithASharpPixelIsNotTold) {
  BenchFrame frame = make_bench_frame(kCase, BenchSlopes::kSmooth, 7);
  const Sensor sensor = tiled_sensor(kCase);
  const Measured before(sensor, frame);
  // The centroids were measured without the cosmic ray, as where sharp pixels are left out.
  frame.pixels(4 * kCase.window_px + 1, 5 * kCase.window_px + 1) = 60000;
  Image<float> light(kCase.rows, kCase.cols);
  Image<float> area(kCase.rows, kCase.cols);
  sum_window_light(before.plan, frame.view(), before.centroids, &before.levels, light, area);
  for (int row = 0; row < kCase.rows; ++row)
    for (int col = 0; col < kCase.cols; ++col)
      EXPECT_EQ(area(row, col), row == 4 && col == 5 ? 0.0F : 100.0F) << row << ", " << col;
}

TEST(WindowLight, BadPixelsCountLikeTheMeanOfTheOthers) {
  Sensor sensor = tiled_sensor(kCase);
  BenchFrame frame = make_bench_frame(kCase, BenchSlopes::kSmooth, 7);
  for (std::size_t i = 0; i < frame.pixels.size(); ++i) frame.pixels[i] = 300;
  sensor.bad_pixel = Image<std::uint8_t>(frame.format.rows, frame.format.cols);
  for (int x = 0; x < frame.format.cols; ++x) sensor.bad_pixel(25, x) = 1;
  frame.pixels(25, 31) = 0;
  const CentroidPlan plan(sensor, frame.format);
  Centroids centroids(kCase.rows, kCase.cols);
  find_centroids(plan, frame.view(), centroids);
  Image<float> light(kCase.rows, kCase.cols);
  Image<float> area(kCase.rows, kCase.cols);
  sum_window_light(plan, frame.view(), centroids, nullptr, light, area);
  for (int row = 0; row < kCase.rows; ++row)
    EXPECT_NEAR(light(row, 3), 100.0 * (300.0 - kBenchBackgroundAdu), 1.0) << row;
}

TEST(WindowLight, FollowsTheWindowsAndEndsAtTheFramesEdge) {
  BenchFrame frame = make_bench_frame(kCase, BenchSlopes::kSmooth, 7);
  for (int y = 0; y < frame.format.rows; ++y)
    for (int x = 0; x < frame.format.cols; ++x)
      frame.pixels(y, x) = static_cast<std::uint16_t>(200 + x + 2 * y);
  const Sensor sensor = tiled_sensor(kCase);
  const CentroidPlan plan(sensor, frame.format);
  Centroids centroids(kCase.rows, kCase.cols);
  centroids.flux_adu.fill(1e9F);  // so that nothing is taken for a sharp pixel
  Image<float> before(kCase.rows, kCase.cols);
  Image<float> light(kCase.rows, kCase.cols);
  Image<float> area(kCase.rows, kCase.cols);
  sum_window_light(plan, frame.view(), centroids, nullptr, before, area);
  centroids.moved_x_px.fill(3.0F);
  centroids.moved_y_px.fill(-2.0F);
  sum_window_light(plan, frame.view(), centroids, nullptr, light, area);
  EXPECT_NEAR(light(5, 6) - before(5, 6), 100.0 * (3.0 - 2.0 * 2.0), 0.5);
  EXPECT_EQ(area(0, 0), 80.0F);
  EXPECT_EQ(area(5, kCase.cols - 1), 70.0F);
}

}  // namespace
}  // namespace curlew
