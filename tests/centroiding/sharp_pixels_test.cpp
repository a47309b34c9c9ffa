// A pixel that is too sharp to be light through the optics enters no sum, and light is never taken
// for one.
#include "centroiding/sharp_pixels.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "acquisition/simulator/random_stream.h"
#include "acquisition/simulator/simulator.h"
#include "centroiding/centroid_methods.h"
#include "service/bench/bench_frames.h"
#include "tests/support/exact_sensor.h"

namespace curlew {
namespace {

constexpr std::uint64_t kHitSeed = 20261130;
constexpr BenchCase kHitCase{16, 16, 12};

Sensor sensor_of_spots(CentroidMethod method = CentroidMethod::kThresholded) {
  Sensor sensor = tiled_sensor(kHitCase);
  sensor.method = method;
  // σ is P/6 = 2 px: on a pixel's centre the peak is 1.13 of its neighbours at most.
  sensor.spot_sharpness = 1.13;
  return sensor;
}

struct Measured {
  explicit Measured(const BenchFrame& frame, const CentroidOptions& options = {})
      : sensor(sensor_of_spots(options.method)),
        plan(sensor, frame.format, options),
        level_plan(sensor, plan, options),
        sharp_plan(sensor, frame.format),
        levels(level_plan),
        sharp(kHitCase.rows, kHitCase.cols),
        centroids(kHitCase.rows, kHitCase.cols) {
    measure_levels(level_plan, level_plan.pixels(), frame.view(), levels);
    find_sharp_pixels(sharp_plan, plan, plan.spots, frame.view(), levels, sharp);
    find_centroids(plan, frame.view(), centroids, {&levels, &sharp});
  }
  Sensor sensor;
  CentroidPlan plan;
  LevelPlan level_plan;
  SharpPixelPlan sharp_plan;
  FrameLevels levels;
  SharpPixels sharp;
  Centroids centroids;
};

TEST(SharpPixels, LightIsNone) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const Measured measured(make_bench_frame(kHitCase, BenchSlopes::kRandom, kHitSeed + seed));
    EXPECT_TRUE(measured.sharp.pixels.empty()) << "seed " << kHitSeed + seed;
    EXPECT_FALSE(measured.sharp.any_broken) << "seed " << kHitSeed + seed;
  }
}

// The pitch is a whole number of pixels, so that all reference spots lie between four pixels.
TEST(SharpPixels, LightIsNoneWhereTheReferenceSpotsLieBetweenPixels) {
  constexpr BenchCase kFine{16, 16, 6};
  Sensor sensor = tiled_sensor(kFine);
  sensor.spot_sharpness = 1.0;
  sensor.spot_gaussian_px = 1.0;
  const BenchFrame frame = make_bench_frame(kFine, BenchSlopes::kRandom, kHitSeed);
  const CentroidPlan plan(sensor, frame.format);
  const LevelPlan level_plan(sensor, plan, {});
  const SharpPixelPlan sharp_plan(sensor, frame.format);
  FrameLevels levels(level_plan);
  SharpPixels sharp(kFine.rows, kFine.cols);
  measure_levels(level_plan, level_plan.pixels(), frame.view(), levels);
  find_sharp_pixels(sharp_plan, plan, plan.spots, frame.view(), levels, sharp);
  EXPECT_TRUE(sharp.pixels.empty());
  // A Gaussian of σ = 1 px gives its middle pixel .383 of the light and the next .242.
  EXPECT_NEAR(sharp_plan.sharpness, 1.4 * 0.3829 / 0.2417, 1e-3);
}

// Side lobes are bright along one axis and dark along the other, as a bright line is; but few of
// their pixels have the light that a line must have beside its own photon noise.
TEST(SharpPixels, SideLobesAreHardlyLookedAt) {
  SimulatorOptions options;
  options.window_px = 10;
  options.photons = 3000.0;
  options.seed = kHitSeed;
  Simulator simulator(options);
  FrameBuffer frame(simulator.format());
  ASSERT_EQ(simulator.next(frame), Delivery::kFrame);
  Sensor sensor = sensor_of(simulator, options.window_px, options.bias_adu);
  sensor.spot_sharpness = 1.5;
  sensor.spot_gaussian_px = 0.85;
  const CentroidPlan plan(sensor, simulator.format());
  const LevelPlan level_plan(sensor, plan, {});
  const SharpPixelPlan sharp_plan(sensor, simulator.format());
  ASSERT_GT(sharp_plan.sharpness, 0.0F);
  FrameLevels levels(level_plan);
  SharpPixels sharp(sensor.valid.rows(), sensor.valid.cols());
  measure_levels(level_plan, level_plan.pixels(), frame.view(), levels);
  find_sharp_pixels(sharp_plan, plan, plan.spots, frame.view(), levels, sharp);
  EXPECT_TRUE(sharp.pixels.empty());
  const auto lenslets = static_cast<double>(sensor.valid.size());
  std::printf("candidates a lenslet: %.2f faults, %.2f clumps\n",
              static_cast<double>(sharp.candidates.size()) / lenslets,
              static_cast<double>(sharp.clump_candidates.size()) / lenslets);
  EXPECT_LT(static_cast<double>(sharp.candidates.size()) / lenslets, 0.1);
}

TEST(SharpPixels, HitLensletsAreWhereTheyWouldBeWithoutTheHit) {
  const BenchFrame clean = make_bench_frame(kHitCase, BenchSlopes::kSmooth, kHitSeed);
  const Measured before(clean);
  BenchFrame hit = clean;
  RandomStream random(kHitSeed, 1);
  const int n_hits = 40;
  for (int i = 0; i < n_hits; ++i) {
    // One in each of 40 lenslets, none at the frame's rim.
    const int k = 6 * i + 1;
    const int x =
        kHitCase.window_px * (k % kHitCase.cols) + 1 + static_cast<int>(10.0 * random.uniform());
    const int y =
        kHitCase.window_px * (k / kHitCase.cols) + 1 + static_cast<int>(10.0 * random.uniform());
    std::uint16_t& count = hit.pixels(y, x);
    count = static_cast<std::uint16_t>(count + 40000);
  }
  for (const CentroidMethod method : {CentroidMethod::kThresholded, CentroidMethod::kWeighted}) {
    CentroidOptions options;
    options.method = method;
    const Measured clean_again(clean, options);
    const Measured after(hit, options);
    EXPECT_EQ(after.sharp.pixels.size(), static_cast<std::size_t>(n_hits));
    double worst = 0.0;
    for (std::size_t k = 0; k < after.centroids.state.size(); ++k) {
      ASSERT_EQ(after.centroids.state[k], clean_again.centroids.state[k]) << k;
      const auto dx = static_cast<double>(after.centroids.x_px[k] - clean_again.centroids.x_px[k]);
      const auto dy = static_cast<double>(after.centroids.y_px[k] - clean_again.centroids.y_px[k]);
      if (after.sharp.first[k] < 0) {
        EXPECT_EQ(dx, 0.0) << k;
        continue;
      }
      worst = std::max(worst, std::hypot(dx, dy));
    }
    // Its neighbours stand in for a pixel of the spot itself: what they miss is the curvature.
    EXPECT_LT(worst, 0.1) << name_of(method);
  }
}

// The lists hold 4 pixels a lenslet that are replaced, and 16 that are looked at.
TEST(SharpPixels, WhereMorePixelsAreHotThanTheListsHoldLensletsAreMissing) {
  const BenchFrame clean = make_bench_frame(kHitCase, BenchSlopes::kSmooth, kHitSeed);
  const Measured before(clean);
  for (const int apart : {4, 2}) {
    BenchFrame hot = clean;
    for (int y = 1; y < hot.pixels.rows() - 1; y += 3)
      for (int x = 1; x < hot.pixels.cols() - 1; x += apart)
        hot.pixels(y, x) = static_cast<std::uint16_t>(hot.pixels(y, x) + 20000);
    const Measured after(hot);
    ASSERT_EQ(apart == 2, after.sharp.candidates.overflow() > 0);
    ASSERT_EQ(after.sharp.pixels.size(), after.sharp.pixels.capacity());
    int replaced = 0, missing = 0;
    for (std::size_t k = 0; k < after.centroids.state.size(); ++k) {
      if (after.centroids.state[k] != LensletState::kValid) {
        EXPECT_EQ(after.centroids.state[k], LensletState::kBadPixels) << k;
        ++missing;
        continue;
      }
      ++replaced;
      const auto off =
          static_cast<double>(std::hypot(after.centroids.x_px[k] - before.centroids.x_px[k],
                                         after.centroids.y_px[k] - before.centroids.y_px[k]));
      EXPECT_LT(off, 0.3) << k << ", hot pixels " << apart << " apart";
    }
    EXPECT_GT(replaced, 20);
    EXPECT_GT(missing, 150);
  }
}

// A frame that arrives by and by has the same lenslets missing, before its last row is there.
TEST(SharpPixels, AFullListIsTheSameInAFrameThatIsStillArriving) {
  BenchFrame hot = make_bench_frame(kHitCase, BenchSlopes::kSmooth, kHitSeed);
  for (int y = 1; y < hot.pixels.rows() - 1; y += 3)
    for (int x = 1; x < hot.pixels.cols() - 1; x += 2)
      hot.pixels(y, x) = static_cast<std::uint16_t>(hot.pixels(y, x) + 20000);
  const Measured whole(hot);
  Measured parts(hot);
  begin_sharp_pixels(parts.sharp);
  Image<std::uint8_t> broken(kHitCase.rows, kHitCase.cols);
  for (int ready = 5, row = 0; row < kHitCase.rows;
       ready = std::min(ready + 7, hot.pixels.rows())) {
    const int looked_at = find_sharp_pixels_rows(parts.sharp_plan, parts.plan, parts.plan.spots,
                                                 hot.view(), ready, parts.levels, parts.sharp);
    for (; row < kHitCase.rows && parts.plan.frame_rows_needed(row) <= looked_at; ++row)
      for (int c = 0; c < kHitCase.cols; ++c) broken(row, c) = parts.sharp.broken(row, c);
  }
  for (std::size_t k = 0; k < broken.size(); ++k) EXPECT_EQ(broken[k], whole.sharp.broken[k]) << k;
}

TEST(SharpPixels, AHitInADarkWindowIsNoSpot) {
  BenchFrame frame = make_bench_frame(kHitCase, BenchSlopes::kSmooth, kHitSeed);
  for (std::uint16_t& count : frame.pixels) count = 100;
  frame.pixels(30, 31) = 30000;
  const Measured measured(frame);
  ASSERT_EQ(measured.sharp.pixels.size(), 1U);
  for (std::size_t k = 0; k < measured.centroids.state.size(); ++k)
    EXPECT_EQ(measured.centroids.state[k], LensletState::kFaint) << k;
  EXPECT_EQ(measured.centroids.flux_adu(2, 2), 0.0F);
}

// Each candidate costs a search for its lenslet: 10 % of the pixels once did, in noise alone.
TEST(SharpPixels, NoiseAndBrightSpotsMakeHardlyACandidate) {
  for (const double sharpness : {1.13, 1.8, 2.8}) {
    const BenchFrame frame = make_bench_frame(kHitCase, BenchSlopes::kRandom, kHitSeed);
    Sensor sensor = sensor_of_spots();
    sensor.spot_sharpness = sharpness;
    const CentroidPlan plan(sensor, frame.format);
    const LevelPlan level_plan(sensor, CentroidPlan(sensor, frame.format), {});
    FrameLevels levels(level_plan);
    SharpPixels sharp(kHitCase.rows, kHitCase.cols);
    measure_levels(level_plan, level_plan.pixels(), frame.view(), levels);
    find_sharp_pixels(SharpPixelPlan(sensor, frame.format), plan, plan.spots, frame.view(), levels,
                      sharp);
    EXPECT_LT(sharp.candidates.size(), frame.pixels.size() / 1000) << sharpness;
  }
}

TEST(SharpPixels, AreNotLookedForWhereSpotsAreAsSharp) {
  BenchFrame frame = make_bench_frame(kHitCase, BenchSlopes::kSmooth, kHitSeed);
  frame.pixels(30, 31) = 65000;
  Sensor sensor = sensor_of_spots();
  for (const double sharpness : {3.5, std::nan("")}) {
    sensor.spot_sharpness = sharpness;
    EXPECT_EQ(SharpPixelPlan(sensor, frame.format).sharpness, 0.0F) << sharpness;
  }
}

}  // namespace
}  // namespace curlew
