// What the encoder is told of the sensor: its rotation exactly, the rest through its inputs.
#include "detect/classifier/sensor_encoder.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>

#include "acquisition/simulator/random_stream.h"
#include "core/frame.h"

namespace curlew {
namespace {

constexpr std::uint64_t kSensorSeed = 20261129;

DenseLayer random_layer() {
  DenseLayer layer(kTaughtInputs, 32);
  RandomStream random(kSensorSeed, 0);
  for (float& weight : layer.weights) weight = static_cast<float>(random.gaussian());
  for (float& bias : layer.bias) bias = static_cast<float>(random.gaussian());
  return layer;
}

/// Returns the modes of a lopsided spot that is turned by angle_rad about its reference.
std::array<float, kSpotFeatures> modes_of_turned_spot(double angle_rad) {
  constexpr int kSide = 96;
  constexpr double kMiddle = 47.5;
  constexpr double kPixels = 20.0;  // a λ/w: so fine that a pixel is a point
  FrameFormat format;
  format.rows = format.cols = kSide;
  SpotCamera camera;
  camera.windows = Image<SpotWindow>(1, 1);
  camera.windows(0, 0) = {0, 0, kSide, kSide, kMiddle, kMiddle};
  camera.pixels_per_lambda_w = kPixels;
  FrameBuffer frame(format);
  auto* counts = reinterpret_cast<std::uint16_t*>(frame.data());
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      const double dx = (x - kMiddle) / kPixels;
      const double dy = (y - kMiddle) / kPixels;
      const double u = std::cos(angle_rad) * dx + std::sin(angle_rad) * dy;
      const double v = std::cos(angle_rad) * dy - std::sin(angle_rad) * dx;
      // It vanishes within the reach of the modes, so that their square border cuts nothing.
      const double main = std::exp(-9.0 * ((u - 0.3) * (u - 0.3) + 2.0 * (v + 0.2) * (v + 0.2)));
      const double side = 0.5 * std::exp(-12.0 * ((u + 0.5) * (u + 0.5) + (v - 0.3) * (v - 0.3)));
      counts[y * kSide + x] = static_cast<std::uint16_t>(std::lround(30000.0 * (main + side)));
    }
  }
  std::array<float, kSpotFeatures> features{};
  SpotFeatures(camera, format).measure(frame.view(), {}, 0, 1.0F, 1.0F, features.data());
  return features;
}

TEST(TurnedModes, AreTheModesOfATurnedSpot) {
  const auto upright = modes_of_turned_spot(0.0);
  for (const double degrees : {7.0, 20.0, 45.0, 90.0, -130.0}) {
    const double angle = degrees * std::numbers::pi / 180.0;
    const auto turned = modes_of_turned_spot(angle);
    const auto matrix = turned_modes(angle);
    for (std::size_t i = 0; i < kSpotModes; ++i) {
      double mode = 0.0;
      for (std::size_t j = 0; j < kSpotModes; ++j)
        mode += matrix[i][j] * static_cast<double>(turned[j]);
      // Counts are whole numbers, and places are rounded to 1/16 of a pixel.
      EXPECT_NEAR(mode, static_cast<double>(upright[i]), 2e-3) << degrees << ", mode " << i;
    }
  }
}

TEST(TurnedModes, PreserveLengths) {
  const auto matrix = turned_modes(0.6);
  for (std::size_t i = 0; i < kSpotModes; ++i) {
    for (std::size_t j = 0; j < kSpotModes; ++j) {
      double product = 0.0;
      for (std::size_t k = 0; k < kSpotModes; ++k) product += matrix[i][k] * matrix[j][k];
      EXPECT_NEAR(product, i == j ? 1.0 : 0.0, 1e-12);
    }
  }
}

/// The layer of a sensor gives for its features what the taught one gives for all its inputs.
TEST(LayerForSensor, IsTheTaughtLayerAtTheTraits) {
  const DenseLayer taught = random_layer();
  const SensorTraits traits{.blur = 0.4, .pixel = 0.8, .reach = 1.2};
  const double angle = 0.3;
  const DenseLayer layer = layer_for_sensor(taught, traits, angle);
  ASSERT_EQ(layer.inputs, kSpotFeatures);
  RandomStream random(kSensorSeed, 1);
  std::array<double, kSpotFeatures> features{};
  for (double& feature : features) feature = random.gaussian();
  features.back() = 1.0;
  const auto matrix = turned_modes(angle);
  std::array<double, kSpotFeatures> along = features;
  for (std::size_t i = 0; i < kSpotModes; ++i) {
    along[i] = 0.0;
    for (std::size_t j = 0; j < kSpotModes; ++j) along[i] += matrix[i][j] * features[j];
  }
  const auto factors = trait_factors(traits);
  for (std::size_t o = 0; o < 32; ++o) {
    double expected = static_cast<double>(taught.bias[o]);
    for (std::size_t block = 0; block < kTraitBlocks; ++block) {
      for (std::size_t i = 0; i < kSpotFeatures; ++i)
        expected += static_cast<double>(factors[block]) * along[i] *
                    static_cast<double>(taught.weights[(block * kSpotFeatures + i) * 32 + o]);
    }
    expected += static_cast<double>(reach_input(traits)) *
                static_cast<double>(taught.weights[(kTaughtInputs - 1) * 32 + o]);
    double got = static_cast<double>(layer.bias[o]);
    for (std::size_t i = 0; i < kSpotFeatures; ++i)
      got += features[i] * static_cast<double>(layer.weights[i * 32 + o]);
    EXPECT_NEAR(got, expected, 1e-4);  // floats of up to 10, a hundred of them
  }
}

/// The benchmark's sensor needs nothing but the first block, so that what the others learn does not
/// touch it.
TEST(LayerForSensor, TheBenchmarksSensorTakesTheFirstBlock) {
  const auto factors = trait_factors({});
  EXPECT_EQ(factors[0], 1.0F);
  for (std::size_t block = 1; block < kTraitBlocks; ++block) EXPECT_EQ(factors[block], 0.0F);
  EXPECT_EQ(reach_input({}), 0.0F);
}

}  // namespace
}  // namespace curlew
