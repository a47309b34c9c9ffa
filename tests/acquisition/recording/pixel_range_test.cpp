// These tests say which values the 16 bits of a frame are for, whatever the unit of a file is.
#include "acquisition/recording/pixel_range.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace curlew {
namespace {

constexpr int kSize = 64;
constexpr unsigned kSeed = 7;

/// Draws spots of light over a background of 100 with noise of standard deviation 3, in counts.
Image<double> draw_counts(double top = 3000.0) {
  std::mt19937_64 random(kSeed);
  std::normal_distribution<double> normal;
  Image<double> frame(kSize, kSize);
  for (int row = 0; row < kSize; ++row) {
    for (int col = 0; col < kSize; ++col) {
      const double x = col % 12 - 5.5;
      const double y = row % 12 - 5.5;
      frame(row, col) = 100.0 + top * std::exp(-(x * x + y * y) / 4.5) + 3.0 * normal(random);
    }
  }
  return frame;
}

Image<double> scaled(Image<double> frame, double unit) {
  for (double& value : frame) value *= unit;
  return frame;
}

PixelMap map_of(const Image<double>& frame) {
  PixelRange range;
  EXPECT_EQ(range.add(frame), frame.size());
  return range.choose_map();
}

TEST(PixelRange, TheNoiseIsThatBetweenTheSpots) {
  for (const double unit : {1e-30, 1.0 / 65535.0, 0.01, 1.0, 1e20}) {
    PixelRange range;
    range.add(scaled(draw_counts(), unit));
    // Two thirds of the pixels lie on the flanks of a spot. The 10th percentile of all differences
    // is then the 30th of those that are noise alone, which is three times as large.
    EXPECT_GT(range.noise(), 2.5 * unit);
    EXPECT_LT(range.noise(), 10.0 * unit);
  }
}

TEST(PixelRange, TheStepIsFarBelowTheNoiseInAnyUnit) {
  for (const double top : {300.0, 3000.0, 30000.0}) {
    for (const double unit : {1e-30, 1.0 / 65535.0, 0.01, 1.0, 1e20}) {
      const PixelMap map = map_of(scaled(draw_counts(top), unit));
      EXPECT_FALSE(map.leaves_out);
      // The step is an eighth of the noise that is found, which is three times too large at most.
      EXPECT_LT(map.scale, 3.0 * unit * 3.0 / 8.0) << top << " " << unit;
      EXPECT_LE((map.max - map.min) / map.scale, 65535.5);
    }
  }
}

TEST(PixelRange, OneFarPixelLeavesTheMapOfTheOthers) {
  for (const double unit : {1.0 / 65535.0, 0.01, 1.0}) {
    const Image<double> frame = scaled(draw_counts(), unit);
    const PixelMap without = map_of(frame);
    for (const double far : {-1e30, 1e38, -1e300, -2147483648.0, 1e9}) {
      Image<double> flagged = frame;
      flagged(5, 7) = far;
      const PixelMap map = map_of(flagged);
      EXPECT_TRUE(map.leaves_out) << far;
      EXPECT_FALSE(map.holds(far));
      // The pixel that was flagged is missing, and may have been the least.
      EXPECT_NEAR(map.min, without.min, 3.0 * unit) << far;
      EXPECT_EQ(map.max, without.max) << far;
    }
  }
}

TEST(PixelRange, FlagsOnBothSidesAndInWholeColumnsAreLeftOut) {
  Image<double> frame = scaled(draw_counts(), 0.01);
  for (int row = 0; row < kSize; ++row) frame(row, 0) = row % 2 == 0 ? -1e30 : 1e30;
  frame(3, 3) = 1e38;
  const PixelMap map = map_of(frame);
  EXPECT_TRUE(map.leaves_out);
  EXPECT_GT(map.min, 0.0);
  EXPECT_LT(map.max, 100.0);
}

TEST(PixelRange, SpotsAreNoOutliersHoweverBrightAndFew) {
  std::mt19937_64 random(kSeed);
  std::normal_distribution<double> normal;
  for (const double noise : {0.0, 1e-6, 1e-3}) {
    Image<double> frame(256, 256);
    for (int row = 0; row < 256; ++row) {
      for (int col = 0; col < 256; ++col) {
        const double r2 = std::pow(col - 100.3, 2) + std::pow(row - 90.1, 2);
        frame(row, col) = std::exp(-r2 / 4.5) + noise * normal(random);
      }
    }
    EXPECT_FALSE(map_of(frame).leaves_out) << noise;
  }
}

TEST(PixelRange, WholeNumbersThatFitKeepAllValues) {
  Image<double> frame = draw_counts();
  for (double& value : frame) value = std::round(value);
  frame(5, 7) = -40000.0;
  const PixelMap map = map_of(frame);
  EXPECT_FALSE(map.leaves_out);
  EXPECT_EQ(map.scale, 1.0);
  EXPECT_EQ(map.min, -40000.0);
}

}  // namespace
}  // namespace curlew
