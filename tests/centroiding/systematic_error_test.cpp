// The systematic error of spots enters variances as far as a frame shows it.
#include "centroiding/systematic_error.h"

#include <gtest/gtest.h>

#include <cmath>
#include <iostream>
#include <limits>
#include <random>

#include "service/bench/bench_frames.h"

namespace curlew {
namespace {

constexpr unsigned kSeed = 11;

/// Returns slopes of noise as stated, and of `systematic` times as much variance besides.
SlopeField noisy_slopes(int side, double systematic, std::mt19937& random) {
  SlopeField slopes(side, side);
  std::normal_distribution<double> normal;
  for (std::size_t k = 0; k < slopes.x.size(); ++k) {
    const double noise = 0.01 + 0.001 * static_cast<double>(k % 7);
    const double spread = std::sqrt(noise * (1.0 + systematic));
    // x and y are correlated by .5.
    const double common = normal(random);
    const double own = normal(random);
    slopes.x[k] = static_cast<float>(spread * common);
    slopes.y[k] = static_cast<float>(spread * (0.5 * common + std::sqrt(0.75) * own));
    slopes.variance_x[k] = slopes.variance_y[k] = static_cast<float>(noise);
    slopes.covariance_xy[k] = static_cast<float>(0.5 * noise);
    slopes.valid[k] = 1;
  }
  return slopes;
}

/// Returns the mean part that frames show.
double mean_part(int side, double systematic) {
  constexpr int kFrames = 200;
  std::mt19937 random(kSeed);
  Centroids centroids(side, side);
  centroids.state.fill(LensletState::kValid);
  double sum = 0.0;
  for (int i = 0; i < kFrames; ++i) {
    const SlopeField slopes = noisy_slopes(side, systematic, random);
    CellSample sample;
    sample_cells(centroids, slopes, sample);
    const float part = systematic_part(sample, slopes);
    EXPECT_GE(part, 0.0F);
    EXPECT_LE(part, 1.0F);
    sum += static_cast<double>(part);
  }
  return sum / kFrames;
}

// A frame of noise passes 1.25 standard deviations, from which on the part grows, in 11 % of all
// cases, and is then hardly beyond.
TEST(SystematicError, FramesOfNoiseShowNone) {
  std::cout << "seed " << kSeed << "\n";
  EXPECT_LT(mean_part(16, 0.0), 0.06);
  EXPECT_LT(mean_part(80, 0.0), 0.06);
}

TEST(SystematicError, IsShownWhereItIsAsLargeAsTheNoise) {
  std::cout << "seed " << kSeed << "\n";
  EXPECT_GT(mean_part(16, 1.0), 0.95);
  EXPECT_GT(mean_part(80, 1.0), 0.99);
}

TEST(SystematicError, IsTakenForGrantedWhereAFewCellsTellNothing) {
  EXPECT_EQ(mean_part(6, 0.0), 1.0);
  EXPECT_LT(mean_part(8, 0.0), 1.0);
}

TEST(SystematicError, EntersVariancesOfSpotsAsTheSlopesMapTakesIt) {
  Sensor sensor = tiled_sensor({1, 4, 10});
  sensor.grid.p12 = 0.3;
  sensor.spot_sigma_px = 1.1;
  sensor.gain_x.fill(0.9F);
  const SlopePlan plan(sensor);
  Centroids centroids(1, 4);
  SlopeField slopes(1, 4);
  slopes.variance_x.fill(0.25F);
  slopes.variance_y.fill(0.5F);
  slopes.covariance_xy.fill(-0.125F);
  centroids.flux_adu.fill(100.0F);
  centroids.xx_px2.fill(1.1F * 1.1F);
  centroids.yy_px2.fill(1.1F * 1.1F);
  slopes.valid.fill(1);
  centroids.xx_px2[1] = 3.0F;
  centroids.flux_adu[2] = 0.0F;  // dark
  slopes.valid[3] = 0;
  const SlopeField before = slopes;
  add_systematic_error(plan, centroids, 0.5F, slopes);
  const auto added = [&](const Image<float> SlopeField::*map, std::size_t k) {
    return (slopes.*map)[k] - (before.*map)[k];
  };
  for (const std::size_t k : {0U, 1U}) {
    const float of_spot = 0.03F * 0.03F * 1.1F * 1.1F;
    const float broader = k == 1 ? 0.08F * 0.08F * (3.0F - 1.1F * 1.1F) : 0.0F;
    const float x = 0.5F * (of_spot + broader) / (0.9F * 0.9F);
    const float y = 0.5F * of_spot;
    EXPECT_NEAR(added(&SlopeField::variance_x, k),
                plan.m11 * plan.m11 * x + plan.m12 * plan.m12 * y, 1e-6);
    EXPECT_NEAR(added(&SlopeField::variance_y, k),
                plan.m21 * plan.m21 * x + plan.m22 * plan.m22 * y, 1e-6);
    EXPECT_NEAR(added(&SlopeField::covariance_xy, k),
                plan.m11 * plan.m21 * x + plan.m12 * plan.m22 * y, 1e-6);
    EXPECT_GT(added(&SlopeField::variance_x, k), 1e-5F);
  }
  for (const std::size_t k : {2U, 3U}) {
    EXPECT_EQ(added(&SlopeField::variance_x, k), 0.0F) << k;
    EXPECT_EQ(added(&SlopeField::variance_y, k), 0.0F) << k;
    EXPECT_EQ(added(&SlopeField::covariance_xy, k), 0.0F) << k;
  }
}

TEST(SystematicError, IsNotKnownWithoutTheReferenceSpot) {
  Sensor sensor = tiled_sensor({1, 1, 10});
  sensor.spot_sigma_px = std::numeric_limits<double>::quiet_NaN();
  const SlopePlan plan(sensor);
  Centroids centroids(1, 1);
  centroids.flux_adu[0] = 100.0F;
  centroids.xx_px2[0] = 9.0F;
  SlopeField slopes(1, 1);
  slopes.valid[0] = 1;
  slopes.variance_x[0] = 0.25F;
  add_systematic_error(plan, centroids, 1.0F, slopes);
  EXPECT_EQ(slopes.variance_x[0], 0.25F);
}

}  // namespace
}  // namespace curlew
