// These tests measure the accuracy on the frames of the benchmark, and compare the noise that the
// centroids claim with the noise that they have.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "centroiding/centroid.h"
#include "service/bench/bench_frames.h"

namespace curlew {
namespace {

TEST(CentroidAccuracy, NoWorseThanTheBestOfOthers) {
  // These are the best that other programs reached on these frames: rms per axis over the lenslets,
  // with a threshold 20 ADU above the background.
  const double best_px[] = {0.0083, 0.0168, 0.0045};
  for (std::size_t i = 0; i < 3; ++i) {
    const auto& which = kBenchCases[i];
    const std::uint64_t seed = 42;
    SCOPED_TRACE("windows of " + std::to_string(which.window_px) + " px, seed 42");
    const auto frame = make_bench_frame(which, BenchSlopes::kRandom, seed);
    const Sensor sensor = tiled_sensor(which);
    const CentroidPlan plan(sensor, frame.format, {.threshold_adu = kBenchThresholdAdu});
    Centroids c(which.rows, which.cols);
    find_centroids(plan, frame.view(), c);
    ASSERT_EQ(c.n_valid, which.rows * which.cols);
    double sum = 0;
    for (std::size_t k = 0; k < c.x_px.size(); ++k) {
      const double ex = c.x_px[k] - sensor.ref_x_px[k] - frame.true_dx_px[k];
      const double ey = c.y_px[k] - sensor.ref_y_px[k] - frame.true_dy_px[k];
      sum += ex * ex + ey * ey;
    }
    const double rms = std::sqrt(sum / (2.0 * c.n_valid));
    RecordProperty("rms_px_" + std::to_string(which.window_px), std::to_string(rms));
    EXPECT_LE(rms, best_px[i]);
  }
}

TEST(CentroidAccuracy, TheOtherMethodsOnTheSameFrames) {
  // These are bounds on the rms per axis after division by the one gain that fits best, as
  // calibration would do it. The Gaussian is as wide as the spots. Each bound is a sixth above what
  // was measured.
  struct Case {
    CentroidMethod method;
    double max_px[3];
  };
  const Case cases[] = {{CentroidMethod::kWeighted, {0.0021, 0.0020, 0.0022}},
                        {CentroidMethod::kCorrelation, {0.0019, 0.0020, 0.0019}},
                        {CentroidMethod::kBrightestPixels, {0.0230, 0.0130, 0.0038}},
                        {CentroidMethod::kMaximumLikelihood, {0.0028, 0.0028, 0.0028}}};
  for (const Case& wanted : cases) {
    for (std::size_t i = 0; i < 3; ++i) {
      const auto& which = kBenchCases[i];
      SCOPED_TRACE(std::string(name_of(wanted.method)) + ", windows of " +
                   std::to_string(which.window_px) + " px, seed 42");
      const auto frame = make_bench_frame(which, BenchSlopes::kRandom, 42);
      Sensor sensor = tiled_sensor(which);
      sensor.method = wanted.method;
      sensor.detector.read_noise_e = kBenchNoiseAdu;
      sensor.detector.e_per_adu = 1.0;
      CentroidOptions options{.threshold_adu = kBenchThresholdAdu};
      options.method = wanted.method;
      options.spot_sigma_px = std::clamp(which.window_px / 6.0, 0.9, 2.0);
      Centroids c(which.rows, which.cols);
      find_centroids(CentroidPlan(sensor, frame.format, options), frame.view(), c);
      ASSERT_EQ(c.n_valid, which.rows * which.cols);
      double moved = 0.0, both = 0.0, truth = 0.0;
      for (std::size_t k = 0; k < c.x_px.size(); ++k) {
        const auto add = [&](float position, float reference, float true_px) {
          const auto d = static_cast<double>(position - reference);
          moved += d * d;
          both += d * static_cast<double>(true_px);
          truth += static_cast<double>(true_px) * static_cast<double>(true_px);
        };
        add(c.x_px[k], sensor.ref_x_px[k], frame.true_dx_px[k]);
        add(c.y_px[k], sensor.ref_y_px[k], frame.true_dy_px[k]);
      }
      const double gain = both / truth;
      const double rms = std::sqrt((moved - both * gain) / (2.0 * c.n_valid)) / gain;
      RecordProperty(std::string(name_of(wanted.method)) + "_" + std::to_string(which.window_px),
                     std::to_string(rms) + " gain " + std::to_string(gain));
      EXPECT_LE(rms, wanted.max_px[i]);
    }
  }
}

/// Returns ∫ sinc² over pixel i of n, for pixels of half a λ/w and a spot at the window's centre.
double sinc2_share(int i, int n) {
  const int steps = 200;
  double sum = 0;
  for (int j = 0; j < steps; ++j) {
    const double u = 0.5 * (i - 0.5 * n + (j + 0.5) / steps);
    const double s =
        std::abs(u) < 1e-9 ? 1.0 : std::sin(std::numbers::pi * u) / (std::numbers::pi * u);
    sum += s * s * 0.5 / steps;
  }
  return sum;
}

TEST(CentroidNoise, TheVarianceClaimedIsTheVarianceMeasured) {
  for (const int window : {6, 8}) {
    for (const double photons : {200.0, 1000.0}) {
      const std::uint64_t seed = 9;
      SCOPED_TRACE("window " + std::to_string(window) + ", photons " + std::to_string(photons) +
                   ", seed 9");
      std::mt19937_64 random(seed);
      std::normal_distribution<double> read_noise(0.0, 1.0);
      const int n = 150;
      Sensor sensor = tiled_sensor({n, n, window});
      sensor.background_adu = 100.0;
      sensor.detector.e_per_adu = 0.5;
      sensor.detector.read_noise_e = 1.0;
      FrameFormat format;
      format.rows = format.cols = n * window;
      std::vector<std::poisson_distribution<int>> light;
      for (int i = 0; i < window * window; ++i) {
        light.emplace_back(photons * sinc2_share(i / window, window) *
                           sinc2_share(i % window, window));
      }
      Image<std::uint16_t> pixels(format.rows, format.cols);
      for (int y = 0; y < format.rows; ++y) {
        for (int x = 0; x < format.cols; ++x) {
          auto& photons_here = light[static_cast<std::size_t>((y % window) * window + x % window)];
          pixels(y, x) = static_cast<std::uint16_t>(
              std::lround(100.0 + 2.0 * (photons_here(random) + read_noise(random))));
        }
      }
      const CentroidPlan plan(sensor, format);
      Centroids c(n, n);
      find_centroids(plan,
                     {reinterpret_cast<const std::byte*>(pixels.data()), format.rows, format.cols,
                      PixelType::kU16},
                     c);
      ASSERT_EQ(c.n_valid, n * n);
      double measured = 0, claimed = 0;
      for (std::size_t k = 0; k < c.x_px.size(); ++k) {
        const double dx = c.x_px[k] - sensor.ref_x_px[k];
        const double dy = c.y_px[k] - sensor.ref_y_px[k];
        measured += dx * dx + dy * dy;
        claimed += static_cast<double>(c.variance_x_px2[k] + c.variance_y_px2[k]);
      }
      // The 45,000 squares have a statistical error of .7 %.
      EXPECT_NEAR(measured / claimed, 1.0, 0.04);
      RecordProperty(
          "ratio_" + std::to_string(window) + "_" + std::to_string(static_cast<int>(photons)),
          std::to_string(measured / claimed));
    }
  }
}

}  // namespace
}  // namespace curlew
