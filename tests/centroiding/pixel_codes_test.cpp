// Codes of gains and offsets are as close as they say, and are not used where that is too far.
#include "centroiding/pixel_codes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "centroiding/centroid.h"
#include "service/bench/bench_frames.h"

namespace curlew {
namespace {

constexpr BenchCase kCase{8, 8, 10};

struct Maps {
  Image<float> gain{20, 30};
  Image<float> offset{20, 30};
};

Maps random_maps() {
  Maps maps;
  std::mt19937_64 random(1);
  std::normal_distribution<float> normal;
  for (std::size_t i = 0; i < maps.gain.size(); ++i) {
    maps.gain[i] = i % 50 == 7 ? 0.0F : 1.0F + 0.02F * normal(random);
    maps.offset[i] = i % 50 == 7 ? 9e9F : 120.0F + 3.0F * normal(random);
  }
  return maps;
}

template <typename Code>
void expect_within_half_a_step() {
  const Maps exact = random_maps();
  Maps coded = exact;
  PixelCodes<Code> codes;
  ASSERT_TRUE(code_maps(coded.gain, coded.offset, {1.0, 1.0}, codes));
  for (std::size_t i = 0; i < exact.gain.size(); ++i) {
    if (!(exact.gain[i] > 0.0F)) {
      EXPECT_EQ(codes.gain[i], 0);
      EXPECT_EQ(coded.gain[i], 0.0F);
      continue;
    }
    EXPECT_GT(codes.gain[i], 0);
    // Besides half a step there is the rounding of floats.
    EXPECT_NEAR(coded.gain[i], exact.gain[i], 0.5F * codes.gain_step + 1e-6F);
    EXPECT_NEAR(coded.offset[i], exact.offset[i], 0.5F * codes.offset_step + 2e-5F);
    EXPECT_EQ(coded.gain[i], codes.gain_base + codes.gain_step * static_cast<float>(codes.gain[i]));
  }
}

TEST(PixelCodes, AreWithinHalfAStep) {
  expect_within_half_a_step<std::uint8_t>();
  expect_within_half_a_step<std::uint16_t>();
}

TEST(PixelCodes, EvenMapsAndSimpleValuesAreExact) {
  Maps maps{Image<float>(4, 4, 1.0F), Image<float>(4, 4, 130.25F)};
  PixelCodes<std::uint8_t> codes;
  ASSERT_TRUE(code_maps(maps.gain, maps.offset, {0.0, 0.0}, codes));
  EXPECT_EQ(maps.gain(2, 3), 1.0F);
  EXPECT_EQ(maps.offset(2, 3), 130.25F);
  maps.gain(0, 0) = 0.5F;
  maps.offset(0, 0) = 120.5F;
  ASSERT_TRUE(code_maps(maps.gain, maps.offset, {0.1, 0.1}, codes));
  EXPECT_EQ(maps.gain(0, 0), 0.5F);
  EXPECT_EQ(maps.gain(2, 3), 1.0F);
  EXPECT_EQ(maps.offset(0, 0), 120.5F);
  EXPECT_EQ(maps.offset(2, 3), 130.25F);
}

/// The noise is 3 counts, and .375 of it may be wrong.
TEST(PixelCodes, LengthIsChosenByWhatIsTooCoarse) {
  Sensor sensor = tiled_sensor(kCase);
  add_maps(sensor, 1);
  const FrameFormat format = bench_format(kCase, PixelType::kU16);
  const auto codes = [&] {
    const CentroidPlan plan(sensor, format, {});
    return (plan.short_codes.empty() ? "" : "short") +
           std::string(plan.long_codes.empty() ? "" : "long");
  };
  EXPECT_EQ(codes(), "short");
  sensor.dark_adu(3, 4) = 2000.0F;  // It is a hot pixel: in steps of 8 counts, the rms is 2.3.
  EXPECT_EQ(codes(), "long");
  sensor.bad_pixel(3, 4) = 1;
  EXPECT_EQ(codes(), "short");
  sensor.dark_adu(5, 4) = 1e6F;  // Steps of 16 counts are too coarse again.
  EXPECT_EQ(codes(), "");
  sensor.dark_adu(5, 4) = 100.0F;
  sensor.flat(5, 4) = 0.02F;
  EXPECT_EQ(codes(), "long");
}

TEST(PixelCodes, AddLittleToTheNoiseOfTheFrame) {
  Sensor sensor = tiled_sensor(kCase);
  add_maps(sensor, 2);
  const CentroidPlan plan(sensor, bench_format(kCase, PixelType::kU16), {});
  double square = 0.0;
  int n = 0;
  for (std::size_t i = 0; i < plan.offset.size(); ++i) {
    if (!(plan.gain[i] > 0.0F)) continue;
    const double gain = 1.0 / static_cast<double>(sensor.flat[i]);
    const double exact =
        gain * static_cast<double>(sensor.dark_adu[i]) + static_cast<double>(plan.threshold);
    const double error = static_cast<double>(plan.offset[i]) - exact;
    square += error * error;
    ++n;
  }
  EXPECT_LT(std::sqrt(square / n), kBenchNoiseAdu / 8.0);
}

}  // namespace
}  // namespace curlew
