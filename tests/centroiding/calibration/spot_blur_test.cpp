// Calibration knows how blurred the spots of a reference are, whatever else is in the frame.
#include "centroiding/calibration/spot_blur.h"

#include <gtest/gtest.h>

#include <cmath>

#include "acquisition/simulator/random_stream.h"
#include "acquisition/simulator/simulator.h"
#include "service/bench/field_light.h"
#include "tests/support/exact_sensor.h"

namespace curlew {
namespace {

struct Bench {
  double samples_per_lambda_w;
  int window_px;
  StrayLight stray_light;
};

SimulatorOptions options_of(const Bench& bench) {
  SimulatorOptions options;
  options.rows = options.cols = 8;
  options.window_px = bench.window_px;
  options.samples_per_lambda_w = bench.samples_per_lambda_w;
  options.stray_light = bench.stray_light;
  options.photons = 1000.0;
  return options;
}

/// Returns the blur that is found, in λ/w.
double found_blur(const Simulator& simulator, const Bench& bench, const Image<float>& light) {
  const Sensor sensor = sensor_of(simulator, bench.window_px, 0.0);
  return fit_spot_blur_px(sensor, light) / bench.samples_per_lambda_w;
}

TEST(SpotBlur, IsFoundBetweenNeighboursWithinATwentiethOfLambdaW) {
  for (const Bench& bench :
       {Bench{2.0, 8, StrayLight::kNeighbours}, Bench{2.0, 6, StrayLight::kNeighbours},
        Bench{4.0, 12, StrayLight::kNeighbours}}) {
    Simulator simulator(options_of(bench));
    const Image<float> sharp = simulator.expected_image_e(0);
    for (const double blur : {0.0, 0.1, 0.3, 0.6, 0.8}) {
      const Image<float> light =
          blur > 0.0 ? blurred(sharp, blur * bench.samples_per_lambda_w) : sharp;
      const double found = found_blur(simulator, bench, light);
      EXPECT_NEAR(found * found, blur * blur, blur > 0.5 ? 0.05 : 0.02)
          << bench.samples_per_lambda_w << " px a lambda/w, window " << bench.window_px;
      EXPECT_NEAR(found, blur, blur > 0.2 ? 0.05 : 0.11);
    }
  }
}

TEST(SpotBlur, IsThatOfTheCoreWhereSpotsHaveSkirts) {
  const Bench bench{2.0, 16, StrayLight::kNeighbours};
  Simulator simulator(options_of(bench));
  const Image<float> sharp = simulator.expected_image_e(0);
  Image<float> light = blurred(sharp, 0.3 * bench.samples_per_lambda_w);
  const Image<float> skirt = blurred(sharp, 2.0 * bench.samples_per_lambda_w);
  for (std::size_t i = 0; i < light.size(); ++i) light[i] += 0.25F * skirt[i];
  EXPECT_NEAR(found_blur(simulator, bench, light), 0.3, 0.08);
}

TEST(SpotBlur, StandsNoiseAndHotPixels) {
  const Bench bench{2.0, 8, StrayLight::kNeighbours};
  Simulator simulator(options_of(bench));
  Image<float> light = blurred(simulator.expected_image_e(0), 0.4 * bench.samples_per_lambda_w);
  RandomStream random(20261129, 0);
  for (float& value : light) {
    value = static_cast<float>(random.poisson(static_cast<double>(value)) + random.gaussian());
    if (random.uniform() < 0.005) value += 300.0F;
  }
  EXPECT_NEAR(found_blur(simulator, bench, light), 0.4, 0.05);
}

TEST(SpotBlur, IsUnknownWhereAPixelIsWiderThanDiffraction) {
  const Bench bench{2.0, 8, StrayLight::kNeighbours};
  Simulator simulator(options_of(bench));
  Sensor sensor = sensor_of(simulator, bench.window_px, 0.0);
  sensor.optics.wavelength_m *= 0.1;
  EXPECT_TRUE(std::isnan(fit_spot_blur_px(sensor, simulator.expected_image_e(0))));
}

}  // namespace
}  // namespace curlew
