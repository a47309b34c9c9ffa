// These tests hold for every one of the other centroid methods.
#include "centroiding/centroid_methods.h"

#include <gtest/gtest.h>
#include <hwy/highway.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <random>
#include <string>
#include <utility>

#include "acquisition/simulator/simulator.h"
#include "centroiding/calibration/calibrate.h"
#include "centroiding/slopes.h"
#include "core/error.h"
#include "service/bench/bench_frames.h"
#include "service/sensor/reference_spots.h"

namespace curlew {
namespace {

// These are the counts above the dark at (row, col) of a window.
using Light = std::function<double(int, int)>;

constexpr double kDarkAdu = 10.0;

/// Lenslets in this scene have windows that tile the frame. Its pixels are u16.
struct SpotScene {
  SpotScene(CentroidMethod method, int rows, int cols, int window_px)
      : sensor(tiled_sensor({rows, cols, window_px})), window(window_px) {
    sensor.optics = {};  // λ/w is not known.
    sensor.background_adu = kDarkAdu;
    sensor.detector = {.e_per_adu = 1.0, .read_noise_e = 2.0};
    sensor.detector.saturation_adu = kUnknown;
    sensor.method = options.method = method;
    options.spot_sigma_px = 1.0;
    options.min_snr = 0.0;
    format.rows = rows * window_px;
    format.cols = cols * window_px;
    pixels = Image<std::uint16_t>(format.rows, format.cols, static_cast<std::uint16_t>(kDarkAdu));
  }
  void draw(int row, int col, const Light& light) {
    for (int i = 0; i < window; ++i) {
      for (int j = 0; j < window; ++j) {
        pixels(row * window + i, col * window + j) = static_cast<std::uint16_t>(
            std::lround(std::clamp(kDarkAdu + light(i, j), 0.0, 65535.0)));
      }
    }
  }
  FrameView view() const {
    return {reinterpret_cast<const std::byte*>(pixels.data()), format.rows, format.cols,
            PixelType::kU16};
  }
  Centroids find() const {
    Centroids centroids(sensor.valid.rows(), sensor.valid.cols());
    find_centroids(CentroidPlan(sensor, format, options), view(), centroids);
    return centroids;
  }
  double dx(const Centroids& c, int row, int col) const {
    return static_cast<double>(c.x_px(row, col)) - (col * window + 0.5 * (window - 1));
  }
  double dy(const Centroids& c, int row, int col) const {
    return static_cast<double>(c.y_px(row, col)) - (row * window + 0.5 * (window - 1));
  }

  Sensor sensor;
  CentroidOptions options;
  FrameFormat format;
  Image<std::uint16_t> pixels;
  int window;
};

/// Returns a Gaussian that lies (dx, dy) from the window's centre.
Light gaussian(double peak, double sigma, int window, double dx, double dy) {
  return [=](int i, int j) {
    const double x = j - 0.5 * (window - 1) - dx;
    const double y = i - 0.5 * (window - 1) - dy;
    return peak * std::exp(-0.5 * (x * x + y * y) / (sigma * sigma));
  };
}

class Methods : public testing::TestWithParam<CentroidMethod> {
 protected:
  bool is(CentroidMethod method) const { return GetParam() == method; }
};

TEST_P(Methods, ASpotAtTheCentreIsFoundThere) {
  for (const int window : {5, 6, 8, 11, 33}) {
    SpotScene scene(GetParam(), 1, 4, window);
    scene.draw(0, 0, gaussian(3000.0, 1.0, window, 0.0, 0.0));
    const Centroids c = scene.find();
    SCOPED_TRACE("window " + std::to_string(window));
    ASSERT_EQ(c.state(0, 0), LensletState::kValid);
    // An even window's centre lies between four pixels of equal light. It does not matter which of
    // them the correlation takes for the peak.
    EXPECT_NEAR(scene.dx(c, 0, 0), 0.0, 2e-3);
    EXPECT_NEAR(scene.dy(c, 0, 0), 0.0, 2e-3);
  }
}

TEST_P(Methods, ItFollowsASpot) {
  const int window = 12;
  constexpr double kShifts[] = {-1.6, -1.1, -0.7, -0.3, 0.3, 0.7, 1.1, 1.6};
  SpotScene scene(GetParam(), 1, 8, window);
  for (int k = 0; k < 8; ++k)
    scene.draw(0, k, gaussian(20000.0, 1.0, window, kShifts[k], -0.5 * kShifts[k]));
  const Centroids c = scene.find();
  // The start is wrong by half of the shift. The steps do not run to their end and leave an eighth
  // of that, so that .94 is found. Coarse pixels, and the pixels that are not counted, bend the
  // response of the brightest pixels.
  const double minimum = is(CentroidMethod::kBrightestPixels) ? 0.75 : 0.9;
  const double maximum = is(CentroidMethod::kBrightestPixels) ? 1.3 : 1.02;
  for (int k = 0; k < 8; ++k) {
    SCOPED_TRACE(kShifts[k]);
    EXPECT_GT(scene.dx(c, 0, k) / kShifts[k], minimum);
    EXPECT_LT(scene.dx(c, 0, k) / kShifts[k], maximum);
    EXPECT_GT(scene.dy(c, 0, k) / (-0.5 * kShifts[k]), minimum);
    EXPECT_LT(scene.dy(c, 0, k) / (-0.5 * kShifts[k]), maximum);
  }
}

TEST_P(Methods, MirroredAndTransposedPicturesAreMirroredAndTransposed) {
  const int window = 9;
  for (std::uint32_t seed = 1; seed <= 20; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    Image<double> light(window, window);  // It holds two spots and noise.
    const Light a = gaussian(400.0, 1.0, window, 0.8 * normal(random), 0.8 * normal(random));
    const Light b = gaussian(300.0, 1.0, window, 0.8 * normal(random), 0.8 * normal(random));
    for (int i = 0; i < window; ++i)
      for (int j = 0; j < window; ++j) light(i, j) = a(i, j) + b(i, j) + 3.0 * normal(random);
    SpotScene scene(GetParam(), 1, 4, window);
    scene.draw(0, 0, [&](int i, int j) { return light(i, j); });
    scene.draw(0, 1, [&](int i, int j) { return light(i, window - 1 - j); });
    scene.draw(0, 2, [&](int i, int j) { return light(window - 1 - i, j); });
    scene.draw(0, 3, [&](int i, int j) { return light(j, i); });
    const Centroids c = scene.find();
    ASSERT_EQ(c.n_valid, 4);
    constexpr double kRounding = 2e-4;
    EXPECT_NEAR(scene.dx(c, 0, 1), -scene.dx(c, 0, 0), kRounding);
    EXPECT_NEAR(scene.dy(c, 0, 1), scene.dy(c, 0, 0), kRounding);
    EXPECT_NEAR(scene.dx(c, 0, 2), scene.dx(c, 0, 0), kRounding);
    EXPECT_NEAR(scene.dy(c, 0, 2), -scene.dy(c, 0, 0), kRounding);
    EXPECT_NEAR(scene.dx(c, 0, 3), scene.dy(c, 0, 0), kRounding);
    EXPECT_NEAR(scene.dy(c, 0, 3), scene.dx(c, 0, 0), kRounding);
    const auto near = [](float got, float want) {
      EXPECT_NEAR(got, want, 2e-3F * std::abs(want) + 1e-7F);
    };
    near(c.variance_x_px2(0, 1), c.variance_x_px2(0, 0));
    near(c.variance_x_px2(0, 3), c.variance_y_px2(0, 0));
    EXPECT_NEAR(c.covariance_xy_px2(0, 1), -c.covariance_xy_px2(0, 0),
                2e-3F * c.variance_x_px2(0, 0));
  }
}

TEST_P(Methods, BrightnessAloneChangesNothing) {
  const int window = 8;
  SpotScene scene(GetParam(), 1, 4, window);
  scene.sensor.detector.read_noise_e = 0.0;  // This makes no pull and no threshold.
  scene.sensor.detector.e_per_adu = kUnknown;
  scene.options.threshold_noise = 0.0;
  std::mt19937 random(3);
  std::uniform_int_distribution<int> counts(0, 30);
  Image<int> light(window, window);
  for (int i = 0; i < window; ++i)
    for (int j = 0; j < window; ++j)
      light(i, j) = counts(random) + static_cast<int>(gaussian(900.0, 1.0, window, 0.3, 0.4)(i, j));
  for (const int k : {0, 1, 2})
    scene.draw(0, k, [&](int i, int j) { return static_cast<double>(1 << (2 * k)) * light(i, j); });
  const Centroids c = scene.find();
  for (const int k : {1, 2}) {
    EXPECT_NEAR(scene.dx(c, 0, k), scene.dx(c, 0, 0), 2e-4);
    EXPECT_NEAR(scene.dy(c, 0, k), scene.dy(c, 0, 0), 2e-4);
  }
  EXPECT_EQ(c.variance_x_px2(0, 0), 0.0F);  // The noise is not known.
}

TEST_P(Methods, TheVarianceClaimedIsTheVarianceMeasured) {
  const int n = 70;
  for (const double electrons : {200.0, 1000.0, 5000.0}) {
    const std::uint32_t seed = 11;
    SCOPED_TRACE(std::to_string(electrons) + " electrons, seed 11");
    std::mt19937 random(seed);
    std::normal_distribution<double> read_noise(0.0, 1.0);
    const int window = 8;
    const double sigma = 1.0;
    const double peak = electrons / (2.0 * 3.14159265 * sigma * sigma);
    SpotScene scene(GetParam(), n, n, window);
    scene.sensor.detector = {.e_per_adu = 0.25, .read_noise_e = 1.0};
    for (int r = 0; r < n; ++r) {
      for (int c = 0; c < n; ++c) {
        const Light mean = gaussian(peak, sigma, window, 0.35, 0.2);
        scene.draw(r, c, [&](int i, int j) {
          std::poisson_distribution<int> photons(mean(i, j));
          return 4.0 * (photons(random) + read_noise(random)) + 90.0;
        });
      }
    }
    scene.sensor.background_adu = kDarkAdu + 90.0;
    const Centroids c = scene.find();
    ASSERT_EQ(c.n_valid, n * n);
    double sum_x = 0.0, sum_y = 0.0, sum = 0.0, claimed = 0.0;
    for (int r = 0; r < n; ++r) {
      for (int k = 0; k < n; ++k) {
        const double x = scene.dx(c, r, k);
        const double y = scene.dy(c, r, k);
        sum_x += x;
        sum_y += y;
        sum += x * x + y * y;
        claimed += static_cast<double>(c.variance_x_px2(r, k) + c.variance_y_px2(r, k));
      }
    }
    const double lenslets = n * n;
    const double measured = sum / lenslets - (sum_x * sum_x + sum_y * sum_y) / lenslets / lenslets;
    RecordProperty("ratio_" + std::to_string(static_cast<int>(electrons)),
                   std::to_string(measured / (claimed / lenslets)));
    // The 9,800 squares have a statistical error of 1.4 %.
    EXPECT_NEAR(measured / (claimed / lenslets), 1.0, 0.15);
  }
}

TEST_P(Methods, NothingIsEverNotANumber) {
  const int window = 6;
  SpotScene scene(GetParam(), 3, 4, window);
  scene.sensor.detector.saturation_adu = 60000.0;
  const auto at = [&](int row, int col, double value) {
    return [=](int i, int j) { return i == row && j == col ? value : 0.0; };
  };
  scene.draw(0, 1, [](int, int) { return 1e9; });
  scene.draw(0, 2, [](int, int) { return 500.0; });
  scene.draw(0, 3, at(2, 3, 900.0));
  scene.draw(1, 0, at(0, 0, 900.0));
  scene.draw(1, 1, at(5, 5, 30000.0));
  scene.draw(1, 2, [](int, int) { return -10.0; });
  scene.draw(1, 3, [](int i, int j) { return i == 2 && j == 3 ? 5.0 : -10.0; });
  scene.draw(2, 0, [](int i, int j) { return (i + j) % 2 * 1000.0; });
  scene.draw(2, 1, [](int i, int) { return i == 0 ? 1000.0 : 0.0; });
  scene.draw(2, 2, [](int i, int j) { return i * j > 0 ? 0.0 : 20000.0; });
  for (const double min_snr : {0.0, 5.0}) {
    scene.options.min_snr = min_snr;
    const Centroids c = scene.find();
    EXPECT_EQ(c.state(0, 0), LensletState::kFaint);
    EXPECT_EQ(c.state(0, 1), LensletState::kSaturated);
    EXPECT_EQ(c.n_saturated, 1);
    int valid = 0;
    for (std::size_t k = 0; k < c.state.size(); ++k) {
      valid += c.state[k] == LensletState::kValid ? 1 : 0;
      for (const Image<float>* map :
           {&c.x_px, &c.y_px, &c.flux_adu, &c.xx_px2, &c.yy_px2, &c.xy_px2, &c.variance_x_px2,
            &c.variance_y_px2, &c.covariance_xy_px2}) {
        EXPECT_TRUE(std::isfinite((*map)[k])) << k;
      }
      EXPECT_GE(c.variance_x_px2[k], 0.0F);
      EXPECT_GE(c.variance_y_px2[k], 0.0F);
      if (c.state[k] == LensletState::kFaint && c.x_px[k] == 0.0F) {
        EXPECT_EQ(c.flux_adu[k], 0.0F)
            << "lenslet " << k << " has flux but no position, and might be taken for a spot";
      }
      if (c.state[k] == LensletState::kSaturated) {
        EXPECT_EQ(c.x_px[k], 0.0F);
      }
    }
    EXPECT_EQ(c.n_valid, valid);
    ASSERT_EQ(c.state(0, 3), LensletState::kValid);
    EXPECT_NEAR(scene.dx(c, 0, 3), 0.5, 0.2);
  }
  for (auto& bad : scene.sensor.bad_pixel = Image<std::uint8_t>(18, 24)) bad = 1;
  EXPECT_EQ(scene.find().n_valid, 0);
}

TEST_P(Methods, BytesAndWordsOfTheSameCountsAreTheSame) {
  std::mt19937 random(4);
  for (const bool maps : {false, true}) {
    SpotScene scene(GetParam(), 5, 7, 7);
    scene.sensor.detector.saturation_adu = 255.0;  // Maps are rounded by what counts may be.
    if (maps) add_maps(scene.sensor, 5);
    std::uniform_int_distribution<int> noise(0, 20);
    std::uniform_real_distribution<double> shift(-0.6, 0.6);
    for (int r = 0; r < 5; ++r) {
      for (int c = 0; c < 7; ++c) {
        const Light spot = gaussian(200.0, 1.0, 7, shift(random), shift(random));
        scene.draw(r, c, [&](int i, int j) { return spot(i, j) + noise(random); });
      }
    }
    const Centroids words = scene.find();
    ASSERT_GT(words.n_valid, 25);
    Image<std::uint8_t> bytes(scene.format.rows, scene.format.cols);
    for (std::size_t i = 0; i < bytes.size(); ++i)
      bytes[i] = static_cast<std::uint8_t>(scene.pixels[i]);
    scene.format.pixel_type = PixelType::kU8;
    const CentroidPlan plan(scene.sensor, scene.format, scene.options);
    const FrameView view{reinterpret_cast<const std::byte*>(bytes.data()), scene.format.rows,
                         scene.format.cols, PixelType::kU8};
    Centroids at_once(5, 7), by_rows(5, 7);
    find_centroids(plan, view, at_once);
    for (int row = 0; row < 5; ++row) find_centroids_rows(plan, view, row, row + 1, by_rows);
    EXPECT_EQ(by_rows.n_valid, words.n_valid);
    for (std::size_t k = 0; k < words.x_px.size(); ++k) {
      EXPECT_EQ(at_once.state[k], words.state[k]);
      EXPECT_EQ(at_once.x_px[k], words.x_px[k]);
      EXPECT_EQ(at_once.variance_y_px2[k], words.variance_y_px2[k]);
      // A lenslet's result does not depend on the lenslets in the other lanes of its vectors.
      EXPECT_EQ(by_rows.x_px[k], words.x_px[k]);
      EXPECT_EQ(by_rows.y_px[k], words.y_px[k]);
    }
  }
}

TEST_P(Methods, EveryInstructionSetFindsTheSame) {
  std::mt19937 random(6);
  SpotScene scene(GetParam(), 3, 5, 9);
  std::normal_distribution<double> noise(0.0, 5.0);
  std::uniform_real_distribution<double> shift(-1.0, 1.0);
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 5; ++c) {
      const Light spot = gaussian(400.0, 1.1, 9, shift(random), shift(random));
      scene.draw(r, c, [&](int i, int j) { return spot(i, j) + noise(random); });
    }
  }
  scene.sensor.window(1, 1).w = 7;  // One group has windows of several sizes.
  scene.sensor.window(1, 2).h = 6;
  const Centroids want = scene.find();
  ASSERT_EQ(want.n_valid, 15);
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
    SCOPED_TRACE(hwy::TargetName(target));
    const Centroids got = scene.find();
    for (std::size_t k = 0; k < want.x_px.size(); ++k) {
      EXPECT_NEAR(got.x_px[k], want.x_px[k], 3e-4F);
      EXPECT_NEAR(got.y_px[k], want.y_px[k], 3e-4F);
      EXPECT_NEAR(got.variance_x_px2[k], want.variance_x_px2[k], 2e-3F * want.variance_x_px2[k]);
    }
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
}

TEST_P(Methods, ATiltIsMeasuredInFullOnceCalibrated) {
  constexpr double kTiltX = 0.3;  // rad per pitch
  constexpr double kTiltY = -0.2;
  constexpr int kFrames = 30;
  for (const auto& [window, sampling] : {std::pair{6, 2.0}, {8, 2.0}, {12, 2.0}, {12, 4.0}}) {
    SCOPED_TRACE("window " + std::to_string(window) + ", " + std::to_string(sampling) +
                 " px per lambda/w");
    SimulatorOptions plane;
    plane.rows = plane.cols = 12;
    plane.window_px = window;
    plane.samples_per_lambda_w = sampling;
    plane.frames = kFrames;
    plane.seed = 7501;
    CentroidOptions options;
    options.method = GetParam();
    Simulator reference(plane);
    FrameBuffer frame(reference.format());
    CalibrationInput input;
    input.reference_adu = Image<float>(reference.format().rows, reference.format().cols);
    while (reference.next(frame) == Delivery::kFrame) {
      const auto* counts = frame.view().data<std::uint16_t>();
      for (std::size_t i = 0; i < input.reference_adu.size(); ++i)
        input.reference_adu[i] += static_cast<float>(counts[i]) / kFrames;
    }
    input.reference_frames = kFrames;
    input.optics = reference.optics();
    input.detector = reference.detector();
    input.centroid = options;
    Sensor sensor = calibrate_sensor(input).sensor;
    Simulator again(plane);
    measure_reference_spots(again, options, sensor);

    SimulatorOptions tilted = plane;
    tilted.seed = 7502;
    tilted.scene.tilt_x_rad = kTiltX;
    tilted.scene.tilt_y_rad = kTiltY;
    Simulator source(tilted);
    const CentroidPlan plan(sensor, source.format(), options);
    const SlopePlan slope_plan(sensor);
    Centroids centroids(sensor.grid.rows, sensor.grid.cols);
    SlopeField slopes(sensor.grid.rows, sensor.grid.cols);
    double x = 0.0, y = 0.0;
    int n = 0;
    while (source.next(frame) == Delivery::kFrame) {
      find_centroids(plan, frame.view(), centroids);
      measure_slopes(slope_plan, centroids, slopes);
      for (std::size_t k = 0; k < slopes.x.size(); ++k) {
        if (slopes.valid[k] == 0) continue;
        x += static_cast<double>(slopes.x[k]);
        y += static_cast<double>(slopes.y[k]);
        ++n;
      }
    }
    ASSERT_GT(n, 100 * kFrames);
    RecordProperty(
        "tilt_x_" + std::to_string(window) + "_" + std::to_string(static_cast<int>(sampling)),
        std::to_string(x / n / kTiltX));
    // The noise of the means is .5 %; the rest allows for an error of the gain. The brightest
    // pixels have no single gain, because other pixels are brightest once the spot has moved.
    const double tolerance = is(CentroidMethod::kBrightestPixels) ? 0.17 : 0.02;
    EXPECT_NEAR(x / n / kTiltX, 1.0, tolerance);
    EXPECT_NEAR(y / n / kTiltY, 1.0, tolerance);
  }
}

INSTANTIATE_TEST_SUITE_P(All, Methods,
                         testing::Values(CentroidMethod::kWeighted, CentroidMethod::kCorrelation,
                                         CentroidMethod::kBrightestPixels,
                                         CentroidMethod::kMaximumLikelihood),
                         [](const auto& p) { return std::string(name_of(p.param)); });

TEST(CentroidMethods, PlainIsThresholdedAtNothing) {
  SpotScene scene(CentroidMethod::kPlain, 1, 4, 8);
  scene.draw(0, 0, gaussian(500.0, 1.5, 8, 0.4, -0.3));
  scene.options.threshold_adu = 100.0;
  const Centroids plain = scene.find();
  scene.options = {.threshold_noise = 0.0, .min_snr = 0.0};
  const Centroids thresholded = scene.find();  // The sensor is the same.
  EXPECT_EQ(plain.x_px(0, 0), thresholded.x_px(0, 0));
  EXPECT_EQ(plain.flux_adu(0, 0), thresholded.flux_adu(0, 0));
}

TEST(CentroidMethods, ThePullHoldsDarkLensletsAndNoOthers) {
  SpotScene scene(CentroidMethod::kWeighted, 1, 4, 8);
  scene.draw(0, 0, gaussian(3.0, 1.0, 8, 1.0, 0.0));
  scene.draw(0, 1, gaussian(3000.0, 1.0, 8, 1.0, 0.0));
  Centroids pulled = scene.find();
  EXPECT_LT(scene.dx(pulled, 0, 0), 0.7);
  EXPECT_GT(scene.dx(pulled, 0, 0), 0.0);
  EXPECT_GT(scene.dx(pulled, 0, 1), 0.9);
  scene.options.reference_pull = 0.0;
  EXPECT_GT(scene.dx(scene.find(), 0, 0), 0.8);
}

TEST(CentroidMethods, ASensorServesTheMethodItWasCalibratedFor) {
  SpotScene scene(CentroidMethod::kWeighted, 1, 4, 8);
  scene.options.method = CentroidMethod::kThresholded;
  try {
    scene.find();
    FAIL() << "accepted";
  } catch (const Failure& failure) {
    EXPECT_NE(std::string(failure.what()).find("'weighted'"), std::string::npos);
    EXPECT_NE(std::string(failure.what()).find("'thresholded'"), std::string::npos);
  }
  const SpotScene wide(CentroidMethod::kWeighted, 1, 4, kMaxMethodWindow + 1);
  EXPECT_THROW(wide.find(), UsageError);
}

}  // namespace
}  // namespace curlew
