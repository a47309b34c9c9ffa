// Accuracy on the frames of PEERS.md, and the noise the centroids claim against the noise they
// have.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "centroiding/centroid.h"
#include "service/bench_frames.h"

namespace curlew {
namespace {

TEST(CentroidAccuracy, NoWorseThanTheBestOfOthers) {
  // rms per axis over the lenslets, threshold 20 ADU above the background: the best row there.
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

/// ∫ sinc² over pixel i of n, pixels of half a λ/w, spot at the window's centre.
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
        // Without the widening by 4/F for the estimate's own scatter.
        const double flux_e = 0.5 * static_cast<double>(c.flux_adu[k]);
        claimed +=
            static_cast<double>(c.variance_x_px2[k] + c.variance_y_px2[k]) / (1.0 + 4.0 / flux_e);
      }
      // 45,000 squares: .7 % of statistical error; .5 to 1.5 % of the estimator's.
      EXPECT_NEAR(measured / claimed, 1.0, 0.03);
      RecordProperty(
          "ratio_" + std::to_string(window) + "_" + std::to_string(static_cast<int>(photons)),
          std::to_string(measured / claimed));
    }
  }
}

}  // namespace
}  // namespace curlew
