// These tests compare the kernel with plain double arithmetic for every window size, pixel type,
// threshold and instruction set of this machine. They also test what it says of frames that hold no
// usable spot.
#include <gtest/gtest.h>
#include <hwy/highway.h>

#include <cmath>
#include <cstdint>
#include <random>
#include <string>

#include "centroiding/centroid.h"
#include "core/error.h"
#include "service/bench/bench_frames.h"
#include "tests/centroiding/centroid_reference.h"

namespace curlew {
namespace {

struct KernelScene {
  Sensor sensor;
  FrameFormat format;
  Image<std::uint16_t> u16;
  Image<std::uint8_t> u8;

  FrameView view() const {
    const auto* pixels = format.pixel_type == PixelType::kU16
                             ? reinterpret_cast<const std::byte*>(u16.data())
                             : reinterpret_cast<const std::byte*>(u8.data());
    return {pixels, format.rows, format.cols, format.pixel_type};
  }
  void set(int y, int x, int count) {
    u16(y, x) = static_cast<std::uint16_t>(count);
    u8(y, x) = static_cast<std::uint8_t>(count);
  }
};

/// Makes 2 rows of 3 lenslets of P × P px with a noisy spot in each and a background of 10.
KernelScene make_scene(int window_px, PixelType type, bool maps, std::mt19937_64& random) {
  KernelScene scene;
  scene.sensor = tiled_sensor({2, 3, window_px});
  scene.sensor.background_adu = 10.0;
  scene.sensor.detector.saturation_adu = kUnknown;
  scene.sensor.detector.e_per_adu = 0.7;
  scene.sensor.detector.read_noise_e = 1.2;
  if (maps) add_maps(scene.sensor, random());
  scene.format.rows = scene.sensor.frame_rows;
  scene.format.cols = scene.sensor.frame_cols;
  scene.format.pixel_type = type;
  scene.u16 = Image<std::uint16_t>(scene.format.rows, scene.format.cols);
  scene.u8 = Image<std::uint8_t>(scene.format.rows, scene.format.cols);
  std::uniform_real_distribution<double> uniform(-0.15, 0.15);
  for (int r = 0; r < 2; ++r) {
    for (int c = 0; c < 3; ++c) {
      const double cx = (0.5 + uniform(random)) * window_px - 0.5;
      const double cy = (0.5 + uniform(random)) * window_px - 0.5;
      const double s = 0.2 * window_px;
      for (int y = 0; y < window_px; ++y) {
        for (int x = 0; x < window_px; ++x) {
          const double light =
              180.0 * std::exp(-((x - cx) * (x - cx) + (y - cy) * (y - cy)) / (2 * s * s));
          scene.set(r * window_px + y, c * window_px + x,
                    static_cast<int>(10.0 + light + 30.0 * (0.15 + uniform(random))));
        }
      }
    }
  }
  return scene;
}

class EveryTarget : public testing::Test {
 protected:
  template <typename Check>
  void for_every_target(Check check) {
    for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
      hwy::SetSupportedTargetsForTest(target);
      hwy::GetChosenTarget().Update(hwy::SupportedTargets());
      SCOPED_TRACE(std::string("instruction set ") + hwy::TargetName(target));
      check();
    }
  }
  void TearDown() override {
    hwy::SetSupportedTargetsForTest(0);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  }
};

/// variance_rounding_px2: what differences of large moments may leave of a small variance.
void expect_equal(const KernelScene& scene, const CentroidOptions& options,
                  double variance_rounding_px2 = 1e-12) {
  const CentroidPlan plan(scene.sensor, scene.format, options);
  Centroids got(2, 3);
  find_centroids(plan, scene.view(), got);
  for (std::size_t k = 0; k < 6; ++k) {
    const Window& window = scene.sensor.window[k];
    const auto want =
        test::reference_spot(scene.sensor, scene.format, options, plan, scene.view(), window);
    // These are sums of up to 1600 floats. Their error is some 1e-6 of the largest term, which is
    // the flux times the window's half width (squared for second moments, and once more relative to
    // the small result).
    const double w = std::max(window.w, window.h);
    // Where signals are whole numbers of a unit, one may be wrong by that.
    const double off = plan.words.empty() ? 0.0 : static_cast<double>(plan.words.unit) * w * w;
    EXPECT_NEAR(got.flux_adu[k], want.flux_adu, 3e-6 * want.flux_adu + 1e-6 + off);
    if (got.state[k] != LensletState::kValid) continue;
    const double part = off / want.flux_adu;
    EXPECT_NEAR(got.x_px[k], want.x_px, (3e-6 + 0.5 * part) * w + 1e-5);
    EXPECT_NEAR(got.y_px[k], want.y_px, (3e-6 + 0.5 * part) * w + 1e-5);
    EXPECT_NEAR(got.xx_px2[k], want.xx_px2, (3e-6 + 0.25 * part) * w * w);
    EXPECT_NEAR(got.yy_px2[k], want.yy_px2, (3e-6 + 0.25 * part) * w * w);
    EXPECT_NEAR(got.xy_px2[k], want.xy_px2, (3e-6 + 0.25 * part) * w * w);
    const double scale =
        (2e-5 + 3.0 * part) * (want.variance_x_px2 + want.variance_y_px2) + variance_rounding_px2;
    EXPECT_NEAR(got.variance_x_px2[k], want.variance_x_px2, scale);
    EXPECT_NEAR(got.variance_y_px2[k], want.variance_y_px2, scale);
    EXPECT_NEAR(got.covariance_xy_px2[k], want.covariance_xy_px2, scale);
  }
}

TEST_F(EveryTarget, EqualsPlainArithmeticForEveryWindowSize) {
  for (int window = 2; window <= 40; ++window) {
    const std::uint64_t seed = 100 + static_cast<std::uint64_t>(window);
    SCOPED_TRACE("window " + std::to_string(window) + ", seed " + std::to_string(seed));
    std::mt19937_64 random(seed);
    for (const PixelType type : {PixelType::kU8, PixelType::kU16}) {
      for (const bool maps : {false, true}) {
        KernelScene scene = make_scene(window, type, maps, random);
        for_every_target([&] {
          expect_equal(scene, {.threshold_adu = 25.0});
          expect_equal(scene, {.threshold_relative = 0.3, .threshold_noise = 1.0});
        });
      }
    }
  }
}

TEST_F(EveryTarget, EqualsPlainArithmeticForClippedAndOverlappingWindows) {
  std::mt19937_64 random(7);
  for (int width = 2; width <= 20; ++width) {
    SCOPED_TRACE("width " + std::to_string(width));
    KernelScene scene = make_scene(20, PixelType::kU16, true, random);
    for (std::size_t k = 0; k < 6; ++k) {
      Window& window = scene.sensor.window[k];
      if (k % 2 == 0) window.x0 = std::min(window.x0 + 20 - width, 60 - width);
      window.w = width;
      window.h = 3 + width / 2;
    }
    scene.sensor.window[1] = {3, 5, std::min(2 * width, 40), 30};
    for_every_target([&] { expect_equal(scene, {.threshold_adu = 25.0}); });
  }
}

TEST_F(EveryTarget, FramesNarrowerThanAVectorAreRead) {
  for (int window = 2; window <= 6; ++window) {
    std::mt19937_64 random(11);
    KernelScene scene =
        make_scene(window, PixelType::kU8, false, random);  // It has 6 to 18 columns.
    for_every_target([&] { expect_equal(scene, {.threshold_adu = 25.0}); });
  }
}

// Below 16 electrons the cube in the widening of variances is limited. Spots of so few are valid
// only where they are asked for.
TEST_F(EveryTarget, EqualsPlainArithmeticForSpotsOfFewElectrons) {
  std::mt19937_64 random(12);
  int few = 0;
  for (int window = 10; window <= 20; window += 2) {
    KernelScene scene = make_scene(window, PixelType::kU16, false, random);
    const CentroidOptions options{.threshold_adu = 178.0, .min_snr = 0.0};
    Centroids c(2, 3);
    find_centroids(CentroidPlan(scene.sensor, scene.format, options), scene.view(), c);
    for (std::size_t k = 0; k < 6; ++k)
      few += c.state[k] == LensletState::kValid && 0.7F * c.flux_adu[k] < 16.0F ? 1 : 0;
    SCOPED_TRACE("window " + std::to_string(window) + ", seed 12");
    for_every_target([&] { expect_equal(scene, options, 1e-5); });
  }
  EXPECT_GT(few, 5);
}

class Spots : public testing::Test {
 protected:
  Spots() {
    std::mt19937_64 random(3);
    scene = make_scene(12, PixelType::kU16, false, random);
    scene.sensor.background_adu = 0.0;
    for (auto& pixel : scene.u16) pixel = 0;
  }
  Centroids find(const CentroidOptions& options = {.threshold_noise = 0.0}) const {
    Centroids centroids(2, 3);
    find_centroids(CentroidPlan(scene.sensor, scene.format, options), scene.view(), centroids);
    return centroids;
  }
  KernelScene scene;
};

TEST_F(Spots, OneBrightPixelIsWhereItIs) {
  scene.set(5, 4, 1000);
  scene.set(12 + 6, 24 + 7, 777);
  const Centroids c = find();
  EXPECT_EQ(c.n_valid, 2);
  EXPECT_EQ(c.x_px(0, 0), 4.0F);
  EXPECT_EQ(c.y_px(0, 0), 5.0F);
  EXPECT_EQ(c.flux_adu(0, 0), 1000.0F);
  EXPECT_EQ(c.xx_px2(0, 0), 0.0F);
  EXPECT_EQ(c.x_px(1, 2), 31.0F);
  EXPECT_EQ(c.y_px(1, 2), 18.0F);
  EXPECT_EQ(c.state(0, 1), LensletState::kFaint);
}

TEST_F(Spots, MovingTheSpotMovesTheCentroidAndNothingElse) {
  const auto draw = [&](int r, int c, int at_x, int at_y) {
    for (int y = -2; y <= 2; ++y) {
      for (int x = -2; x <= 2; ++x) {
        scene.set(r * 12 + at_y + y, c * 12 + at_x + x, 900 / (1 + x * x + 2 * y * y) + 13 * x);
      }
    }
  };
  draw(0, 0, 4, 5);
  draw(1, 1, 6, 7);
  const Centroids c = find();
  // Float positions near 20 px are rounded by 2e-6.
  EXPECT_NEAR(c.x_px(1, 1) - c.x_px(0, 0), 14.0, 5e-6);
  EXPECT_NEAR(c.y_px(1, 1) - c.y_px(0, 0), 14.0, 5e-6);
  EXPECT_NEAR(c.xx_px2(1, 1), c.xx_px2(0, 0), 1e-5);
  EXPECT_NEAR(c.variance_x_px2(1, 1) / c.variance_x_px2(0, 0), 1.0, 1e-4);
}

TEST_F(Spots, AGaussianHasItsMoments) {
  // σ is 1.2 and 1.5 px, along the axes. Sampled Gaussians this wide have their variance to 1e-6.
  // The cut at ±5.5 px takes less than 1e-3 of it, and whole counts of 60000 change it by less than
  // 1e-3.
  for (int y = 0; y < 12; ++y) {
    for (int x = 0; x < 12; ++x) {
      const double u = (x - 5.5) / 1.2;
      const double v = (y - 5.5) / 1.5;
      scene.set(y, x, static_cast<int>(std::lround(60000 * std::exp(-0.5 * (u * u + v * v)))));
    }
  }
  const Centroids c = find();
  EXPECT_NEAR(c.x_px(0, 0), 5.5, 1e-4);
  EXPECT_NEAR(c.y_px(0, 0), 5.5, 1e-4);
  EXPECT_NEAR(c.xx_px2(0, 0), 1.44, 2e-3);
  EXPECT_NEAR(c.yy_px2(0, 0), 2.25, 1.2e-2);
  EXPECT_NEAR(c.xy_px2(0, 0), 0.0, 1e-4);
  EXPECT_NEAR(c.covariance_xy_px2(0, 0), 0.0, 1e-3F * c.variance_x_px2(0, 0));
}

TEST_F(Spots, SaysWhatIsWrong) {
  scene.sensor.detector.saturation_adu = 4000.0;
  scene.sensor.valid(0, 0) = 0;
  scene.set(5, 12 + 5, 4000);       // It saturates a pixel.
  scene.set(5, 24 + 11, 2000);      // It lies at the edge.
  scene.set(12 + 5, 5, 3);          // It is faint.
  scene.set(12 + 5, 12 + 5, 3999);  // It is fine.
  scene.sensor.bad_pixel = Image<std::uint8_t>(24, 36);
  for (int y = 12; y < 16; ++y) {
    // A third of the window is bad.
    for (int x = 24; x < 36; ++x) scene.sensor.bad_pixel(y, x) = 1;
  }
  const Centroids c = find();
  EXPECT_EQ(c.state(0, 0), LensletState::kUnlit);
  EXPECT_EQ(c.state(0, 1), LensletState::kSaturated);
  EXPECT_EQ(c.state(0, 2), LensletState::kAtEdge);
  EXPECT_EQ(c.state(1, 0), LensletState::kFaint);
  EXPECT_EQ(c.state(1, 1), LensletState::kValid);
  EXPECT_EQ(c.state(1, 2), LensletState::kBadPixels);
  EXPECT_EQ(c.n_valid, 1);
  EXPECT_EQ(c.n_saturated, 1);
  EXPECT_EQ(c.flux_adu(0, 1), 4000.0F);
  EXPECT_EQ(c.x_px(0, 1), 0.0F);
}

TEST_F(Spots, ASaturatedBadPixelIsOnlyBad) {
  scene.sensor.detector.saturation_adu = 4000.0;
  scene.sensor.bad_pixel = Image<std::uint8_t>(24, 36);
  scene.sensor.bad_pixel(1, 1) = 1;
  scene.set(1, 1, 65535);
  scene.set(5, 4, 1000);
  const Centroids c = find();
  EXPECT_EQ(c.state(0, 0), LensletState::kValid);
  EXPECT_EQ(c.x_px(0, 0), 4.0F);
}

TEST_F(Spots, EmptyAndFullFramesAreDataAndNotNaN) {
  for (const int level : {0, 65535}) {
    for (auto& pixel : scene.u16) pixel = static_cast<std::uint16_t>(level);
    scene.sensor.detector.saturation_adu = 65535.0;
    const Centroids c = find();
    EXPECT_EQ(c.n_valid, 0);
    for (std::size_t k = 0; k < 6; ++k) {
      EXPECT_EQ(c.state[k], level == 0 ? LensletState::kFaint : LensletState::kSaturated);
      EXPECT_EQ(c.x_px[k], 0.0F);
      EXPECT_TRUE(std::isfinite(c.flux_adu[k]));
    }
  }
  scene.sensor.bad_pixel = Image<std::uint8_t>(24, 36, 1);
  const Centroids c = find();
  EXPECT_EQ(c.n_valid, 0);
  EXPECT_EQ(c.state[0], LensletState::kBadPixels);
}

TEST_F(Spots, CalibrationMapsUndoWhatTheDetectorDid) {
  std::mt19937_64 random(5);
  const KernelScene truth = make_scene(12, PixelType::kU16, false, random);
  KernelScene raw = truth;
  raw.sensor.dark_adu = Image<float>(24, 36);
  raw.sensor.flat = Image<float>(24, 36);
  for (std::size_t i = 0; i < raw.u16.size(); ++i) {
    const int dark = 10 + static_cast<int>(i % 7);
    const int response = 1 + static_cast<int>(i % 2);  // It is whole, so that counts stay whole.
    raw.sensor.dark_adu[i] = static_cast<float>(dark);
    raw.sensor.flat[i] = static_cast<float>(response);
    raw.u16[i] = static_cast<std::uint16_t>((truth.u16[i] - 10) * response + dark);
  }
  Centroids want(2, 3), got(2, 3);
  const CentroidOptions options{.threshold_adu = 25.0};
  find_centroids(CentroidPlan(truth.sensor, truth.format, options), truth.view(), want);
  find_centroids(CentroidPlan(raw.sensor, raw.format, options), raw.view(), got);
  EXPECT_EQ(got.n_valid, 6);
  for (std::size_t k = 0; k < 6; ++k) {
    EXPECT_EQ(got.x_px[k], want.x_px[k]);
    EXPECT_EQ(got.flux_adu[k], want.flux_adu[k]);
  }
}

TEST_F(Spots, AnAffineMapOfTheCountsChangesNothingPhysical) {
  for (const bool maps : {false, true}) {
    std::mt19937_64 random(6);
    const KernelScene plain = make_scene(12, PixelType::kU16, maps, random);
    KernelScene mapped = plain;  // Its counts are 4·ADU + 800.
    mapped.format.scale_adu = 0.25;
    mapped.format.zero_adu = -200.0;
    for (auto& pixel : mapped.u16) pixel = static_cast<std::uint16_t>(4 * pixel + 800);
    Centroids want(2, 3), got(2, 3);
    const CentroidOptions options{.threshold_adu = 25.0};
    find_centroids(CentroidPlan(plain.sensor, plain.format, options), plain.view(), want);
    find_centroids(CentroidPlan(mapped.sensor, mapped.format, options), mapped.view(), got);
    // A few roundings of 40 px are 1e-5. With maps, signals and thresholds are rounded to units of
    // a quarter of the noise, which differ.
    const double tolerance = maps ? 1e-3 : 1e-5;
    const double flux_tolerance = maps ? 6e-3 : 1e-5;
    for (std::size_t k = 0; k < 6; ++k) {
      EXPECT_NEAR(got.x_px[k], want.x_px[k], tolerance);
      EXPECT_NEAR(got.flux_adu[k] / want.flux_adu[k], 1.0, flux_tolerance);
      // The finer counts are quantised less: that takes 1/12 count² off some 25 counts² of noise.
      EXPECT_NEAR(got.variance_x_px2[k] / want.variance_x_px2[k], 1.0, 0.015);
    }
  }
}

TEST_F(Spots, RowByRowIsTheSameAsAtOnce) {
  std::mt19937_64 random(8);
  scene = make_scene(12, PixelType::kU16, true, random);
  const CentroidPlan plan(scene.sensor, scene.format, {});
  Centroids whole(2, 3), rows(2, 3);
  find_centroids(plan, scene.view(), whole);
  EXPECT_EQ(plan.frame_rows_needed(0), 12);
  EXPECT_EQ(plan.frame_rows_needed(1), 24);
  find_centroids_rows(plan, scene.view(), 0, 1, rows);
  find_centroids_rows(plan, scene.view(), 1, 2, rows);
  EXPECT_EQ(rows.n_valid, whole.n_valid);
  for (std::size_t k = 0; k < 6; ++k) EXPECT_EQ(rows.x_px[k], whole.x_px[k]);
}

TEST_F(Spots, FramesThatDoNotFitAreRefusedWithBothNumbers) {
  const auto message = [&](const FrameFormat& format) -> std::string {
    try {
      const CentroidPlan plan(scene.sensor, format);
    } catch (const Failure& failure) {
      return failure.what();
    }
    return "";
  };
  FrameFormat other = scene.format;
  other.cols = 40;
  EXPECT_NE(message(other).find("24×40"), std::string::npos);
  EXPECT_NE(message(other).find("24×36"), std::string::npos);
  other = scene.format;
  other.offset_x_px = 8;
  EXPECT_NE(message(other).find("8, 0"), std::string::npos);
  other = scene.format;
  other.binning = 2;
  EXPECT_NE(message(other).find("binning is 2"), std::string::npos);
  EXPECT_THROW(CentroidPlan(scene.sensor, scene.format, {.threshold_relative = 1.0}), UsageError);
}

}  // namespace
}  // namespace curlew
