// Windows measured together, by whole rows of pixels, are measured as each of them is alone.
#include "centroiding/window_strips.h"

#include <gtest/gtest.h>
#include <hwy/highway.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <string>

#include "centroiding/centroid.h"
#include "centroiding/frame_level.h"
#include "centroiding/sharp_pixels.h"
#include "service/bench/bench_frames.h"

namespace curlew {
namespace {

constexpr int kRows = 7;
constexpr int kCols = 37;

/// A frame of light everywhere, and windows of any size on it.
struct StripScene {
  Sensor sensor;
  FrameFormat format;
  AlignedVector<std::byte> pixels;
  CentroidOptions options{.threshold_adu = 20.0};

  StripScene(int pitch, PixelType type, bool maps) {
    const BenchCase which{kRows, kCols, pitch};
    sensor = tiled_sensor(which);
    sensor.detector.saturation_adu = type == PixelType::kU8 ? 240.0 * 16.0 : 4000.0;
    if (maps) add_maps(sensor, 3);
    format = bench_format(which, type);
    pixels = bench_pixels(make_bench_frame(which, BenchSlopes::kRandom, 4), format);
  }
  FrameView view() const { return {pixels.data(), format.rows, format.cols, format.pixel_type}; }
};

/// Moves the windows' edges at random by up to `reach` px, and back into the frame.
void jitter(StripScene& scene, int reach, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::uniform_int_distribution<int> step(-reach, reach);
  const auto& sensor = scene.sensor;
  for (std::size_t k = 0; k < sensor.window.size(); ++k) {
    Window& w = scene.sensor.window[k];
    w.w = std::max(1, w.w + step(random));
    w.h = std::max(1, w.h + step(random));
    w.x0 = std::clamp(w.x0 + step(random), 0, sensor.frame_cols - w.w);
    w.y0 = std::clamp(w.y0 + step(random), 0, sensor.frame_rows - w.h);
    if (random() % 11 == 0) scene.sensor.valid[k] = 0;
  }
}

/// Tilts the rows of windows by `slope`, and drops those that leave the frame.
void tilt(StripScene& scene, double slope) {
  for (std::size_t k = 0; k < scene.sensor.window.size(); ++k) {
    Window& w = scene.sensor.window[k];
    w.y0 += static_cast<int>(std::lround(slope * w.x0));
    if (w.y0 < 0 || w.y0 + w.h > scene.sensor.frame_rows) scene.sensor.valid[k] = 0;
  }
}

int in_strips(const CentroidPlan& plan) {
  int n = 0;
  for (int row = 0; row < kRows; ++row)
    for (const WindowStrip& strip : plan.strips.of_row(row)) n += strip.n;
  return n;
}

/// Compares both ways to measure, with levels and sharp pixels of the frame, on every instruction
/// set. The sums are made in another order, so that they differ by roundings. In whole numbers, a
/// pixel's signal may be wrong by a unit and the threshold by half of one.
void expect_alike(const StripScene& scene) {
  const CentroidPlan plan(scene.sensor, scene.format, scene.options);
  const LevelPlan level_plan(scene.sensor, plan, scene.options);
  FrameLevels levels(level_plan);
  levels.threshold = plan.threshold + 1.5F;
  levels.pixel_variance = plan.pixel_variance + 2.0F;
  for (std::size_t k = 0; k < levels.level.size(); ++k)
    levels.level[k] = std::sin(static_cast<float>(k)) - 0.5F;
  const float unit = plan.words.empty() ? 0.0F : plan.words.unit * plan.adu_per_count;
  SharpPixels sharp(kRows, kCols);
  const std::size_t hit = 2 * kCols + 5;
  const Window& w = scene.sensor.window[hit];
  if (scene.sensor.valid[hit] != 0 && w.x0 > 0 && w.y0 > 0) {
    sharp.pixels.push({w.x0, w.y0, -1});
    sharp.first[hit] = 0;
  }
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
    SCOPED_TRACE(std::string("instruction set ") + hwy::TargetName(target));
    Centroids alone(kRows, kCols), together(kRows, kCols);
    find_centroids(plan, scene.view(), alone, {&levels, &sharp, &plan.spots});
    find_centroids(plan, scene.view(), together, {&levels, &sharp});
    EXPECT_EQ(together.n_valid, alone.n_valid);
    EXPECT_EQ(together.n_saturated, alone.n_saturated);
    for (std::size_t k = 0; k < alone.state.size(); ++k) {
      ASSERT_EQ(together.state[k], alone.state[k]) << k;
      const Window& window = scene.sensor.window[k];
      const auto side = static_cast<float>(std::max({window.w, window.h, 1}));
      const float flux = alone.flux_adu[k];
      const float off = unit * static_cast<float>(window.w * window.h);
      EXPECT_NEAR(together.flux_adu[k], flux, 3e-6F * flux + off) << k;
      const float part = flux > 0.0F ? off / flux : 0.0F;
      const float px = 3e-6F * side + 3e-5F + 0.5F * part * side;
      EXPECT_NEAR(together.x_px[k], alone.x_px[k], px) << k;
      EXPECT_NEAR(together.y_px[k], alone.y_px[k], px) << k;
      const float px2 = (1e-5F + 0.25F * part) * side * side;
      EXPECT_NEAR(together.xx_px2[k], alone.xx_px2[k], px2) << k;
      EXPECT_NEAR(together.yy_px2[k], alone.yy_px2[k], px2) << k;
      EXPECT_NEAR(together.xy_px2[k], alone.xy_px2[k], px2) << k;
      const float scale =
          (1e-4F + 3.0F * part) * (alone.variance_x_px2[k] + alone.variance_y_px2[k]);
      EXPECT_NEAR(together.variance_x_px2[k], alone.variance_x_px2[k], scale) << k;
      EXPECT_NEAR(together.variance_y_px2[k], alone.variance_y_px2[k], scale) << k;
      EXPECT_NEAR(together.covariance_xy_px2[k], alone.covariance_xy_px2[k], scale) << k;
    }
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
}

TEST(WindowStrips, MeasureAsEachWindowAlone) {
  for (const int pitch : {3, 8, 11, 21}) {
    for (const PixelType type : {PixelType::kU8, PixelType::kU16}) {
      for (const bool maps : {false, true}) {
        SCOPED_TRACE("pitch " + std::to_string(pitch) + (maps ? ", maps" : ""));
        StripScene scene(pitch, type, maps);
        EXPECT_EQ(in_strips(CentroidPlan(scene.sensor, scene.format)), kRows * kCols);
        expect_alike(scene);
      }
    }
  }
}

TEST(WindowStrips, WindowsOfAnySizeAndPlace) {
  for (const int reach : {1, 2, 4}) {
    SCOPED_TRACE("up to " + std::to_string(reach) + " px");
    StripScene scene(12, PixelType::kU16, true);
    jitter(scene, reach, static_cast<std::uint64_t>(reach));
    if (reach == 1) {
      EXPECT_GT(in_strips(CentroidPlan(scene.sensor, scene.format)), kRows * kCols / 3);
    }
    expect_alike(scene);
  }
}

TEST(WindowStrips, TiltedRows) {
  for (const double slope : {-0.3, -0.02, 0.01, 0.05}) {
    SCOPED_TRACE("slope " + std::to_string(slope));
    StripScene scene(12, PixelType::kU16, true);
    tilt(scene, slope);
    expect_alike(scene);
  }
}

TEST(WindowStrips, HotPixelsAndBrightSpotsTakeCodes) {
  StripScene hot(12, PixelType::kU16, true);
  for (int i = 0; i < 40; ++i) hot.sensor.dark_adu(2 * i, 3 * i) = 3000.0F;
  const CentroidPlan plan(hot.sensor, hot.format);
  EXPECT_TRUE(plan.words.empty());
  EXPECT_FALSE(plan.codes.empty());
  expect_alike(hot);

  StripScene bright(12, PixelType::kU16,
                    true);  // Some counts do not fit into 16 bits with a fraction.
  bright.sensor.detector.saturation_adu = 65535.0;
  auto* counts = reinterpret_cast<std::uint16_t*>(bright.pixels.data());
  for (std::size_t i = 0; i < bright.format.pixels(); i += 997) counts[i] = 60000;
  EXPECT_LT(CentroidPlan(bright.sensor, bright.format).words.max_count(), 60000.0F);
  expect_alike(bright);
}

TEST(WindowStrips, LevelsBelowTheCalibrationsAreMeasured) {
  StripScene scene(12, PixelType::kU16, true);
  scene.options.threshold_noise = 0.0;
  scene.options.threshold_adu = 0.0;
  for (float& dark : scene.sensor.dark_adu) dark -= 99.0F;  // Thresholds lie at about 0 counts.
  expect_alike(scene);
}

TEST(WindowStrips, WholeNumbersAddLittleToTheNoise) {
  StripScene scene(10, PixelType::kU16, true);
  const CentroidPlan plan(scene.sensor, scene.format, scene.options);
  ASSERT_FALSE(plan.words.empty());
  CentroidPlan exact = plan;
  exact.words = {};
  exact.codes = {};
  for (std::size_t i = 0; i < exact.gain.size(); ++i) {
    if (!(exact.gain[i] > 0.0F)) continue;
    exact.gain[i] = 1.0F / scene.sensor.flat[i];
    exact.offset[i] = exact.gain[i] * scene.sensor.dark_adu[i] + exact.threshold;
  }
  Centroids got(kRows, kCols), want(kRows, kCols);
  find_centroids(plan, scene.view(), got);
  find_centroids(exact, scene.view(), want);
  EXPECT_EQ(got.n_valid, want.n_valid);
  double error = 0.0, variance = 0.0, flux = 0.0;
  for (std::size_t k = 0; k < got.state.size(); ++k) {
    if (want.state[k] != LensletState::kValid) continue;
    const auto dx = static_cast<double>(got.x_px[k] - want.x_px[k]);
    error += dx * dx;
    variance += static_cast<double>(want.variance_x_px2[k]);
    flux += static_cast<double>(got.flux_adu[k] / want.flux_adu[k] - 1.0F) / want.n_valid;
  }
  // A fifth of the noise in quadrature is 2 % of it.
  EXPECT_LT(std::sqrt(error / variance), 0.2);
  EXPECT_LT(std::abs(flux), 2e-3);
}

TEST(WindowStrips, HoldWindowsSideBySideAndNoOthers) {
  Image<WindowSpot> windows(1, 40);
  for (int c = 0; c < 40; ++c)
    windows(0, c) = {.x0 = 10 * c, .y0 = 5, .w = 10, .h = 10, .state = LensletState::kValid};
  WindowStrips strips(1, 40);
  strips.place(windows, 400);
  ASSERT_EQ(strips.of_row(0).size(), 3U);
  EXPECT_EQ(strips.of_row(0)[2].first, 32);
  EXPECT_EQ(strips.of_row(0)[2].n, 8);
  windows(0, 20).x0 -= 1;  // It shares a column with its neighbour.
  windows(0, 30).state = LensletState::kLost;
  strips.place(windows, 400);
  ASSERT_EQ(strips.of_row(0).size(), 4U);
  EXPECT_EQ(strips.of_row(0)[1].first, 16);
  EXPECT_EQ(strips.of_row(0)[1].n, 4);
  EXPECT_EQ(strips.of_row(0)[2].first, 20);
  EXPECT_EQ(strips.of_row(0)[2].n, 10);
  EXPECT_EQ(strips.of_row(0)[3].first, 31);
  strips.place(windows, kWidestVector - 1);  // Narrow frames have none.
  EXPECT_TRUE(strips.of_row(0).empty());
}

}  // namespace
}  // namespace curlew
