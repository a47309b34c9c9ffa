#include "centroiding/calibration/spot_model.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <string>

namespace curlew {
namespace {

/// Returns a spot in the middle of a square window, whose light is 1 and which has no threshold.
SpotView centred(int side_px) {
  return {.window = {0, 0, side_px, side_px},
          .x_px = 0.5 * (side_px - 1),
          .y_px = 0.5 * (side_px - 1),
          .total_adu = 1.0};
}

TEST(SpotModel, HasTheWindowGainsOfSincSquared) {
  // The gains are 1 − 2W·S(W)/∫S for windows of ±W λ/w. Pixels of 1/40 λ/w differ from points by
  // 1e-3 of the gain at W = 0.5, where the light at the edge is steepest.
  constexpr int kPixels = 40;
  const SpotModel model(kPixels, 0.0);
  const struct {
    double half_width;
    double gain;
  } kKnown[] = {{0.5, 0.475}, {1.0, 0.999}, {1.5, 0.855}, {2.0, 1.000}, {4.0, 1.000}};
  for (const auto& known : kKnown) {
    SCOPED_TRACE("W = " + std::to_string(known.half_width));
    const WindowGain gain =
        model.window_gain(centred(static_cast<int>(std::lround(2 * known.half_width * kPixels))));
    EXPECT_NEAR(gain.x, known.gain, 0.003);
    EXPECT_NEAR(gain.y, known.gain, 0.003);
  }
}

TEST(SpotModel, HasTheWindowGainOfCoarsePixels) {
  // The window is ±1.5 λ/w, and a pixel is .5 λ/w.
  const WindowGain gain = SpotModel(2.0, 0.0).window_gain(centred(6));
  EXPECT_NEAR(gain.x, 0.852, 0.003);
}

TEST(SpotModel, SharesAreSincSquaredOverThePixel) {
  const double d = 2.0;
  const SpotModel model(d, 0.0);
  for (const double x : {0.0, 0.7, 2.0, 5.5, 40.0}) {
    constexpr int kSteps = 1000;
    double sum = 0.0;
    for (int i = 0; i < kSteps; ++i) {
      const double u = std::numbers::pi * (x - 0.5 + (i + 0.5) / kSteps) / d;
      const double s = std::abs(u) < 1e-9 ? 1.0 : std::sin(u) / u;
      sum += s * s / (d * kSteps);
    }
    // The midpoint rule's own error is 1e-7.
    EXPECT_NEAR(model.share(x), sum, 1e-6) << "at " << x;
  }
}

TEST(SpotModel, BlurWithoutDiffractionIsAGaussian) {
  const double sigma = 1.3;
  const SpotModel model(0.0, sigma);
  const auto below = [&](double x) { return 0.5 * std::erfc(-x / (sigma * std::sqrt(2.0))); };
  for (const double x : {0.0, 1.0, 2.5, 6.0})
    EXPECT_NEAR(model.share(x), below(x + 0.5) - below(x - 0.5), 1e-6) << "at " << x;
}

TEST(SpotModel, FluxDeterminesTheLight) {
  const SpotModel model(2.0, 0.4);
  SpotView view = centred(8);
  view.x_px += 0.3;
  for (const double relative : {0.0, 0.2}) {
    view.threshold_adu = 4.0;
    view.threshold_relative = relative;
    view.total_adu = 700.0;
    const double flux = model.moments(view).flux_adu;
    EXPECT_NEAR(model.total_for_flux(view, flux), 700.0, 1e-4);
  }
}

TEST(SpotModel, MomentsAreTheMeanOverNoisyFrames) {
  const SpotModel model(2.0, 0.0);
  SpotView view = centred(12);
  view.x_px += 0.4;
  view.total_adu = 2000.0;
  view.threshold_adu = 4.0;
  view.noise_adu = 1.5;
  view.adu_per_e = 1.0;
  const SpotMoments expected = model.moments(view);

  const Image<float> light = model.picture(view);
  constexpr unsigned kSeed = 77;
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  std::normal_distribution<double> normal;
  constexpr int kFrames = 4000;
  double flux = 0.0;
  double moment = 0.0;
  for (int frame = 0; frame < kFrames; ++frame) {
    for (int r = 0; r < 12; ++r) {
      for (int c = 0; c < 12; ++c) {
        const double mean = static_cast<double>(light(r, c));
        const double value = mean + normal(random) * std::sqrt(1.5 * 1.5 + mean);
        const double signal = std::max(value - 4.0, 0.0);
        flux += signal;
        moment += signal * c;
      }
    }
  }
  // The photon noise of 8e6 electrons is 4e-4 of the flux, and 1.3 px·4e-4 of the position. The
  // limits are five σ.
  EXPECT_NEAR(flux / kFrames / expected.flux_adu, 1.0, 2e-3);
  EXPECT_NEAR(moment / flux, expected.x_px, 2.5e-3);
}

}  // namespace
}  // namespace curlew
