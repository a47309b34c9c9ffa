// These tests compare slopes with the formula of docs/conventions.md, on straight, rotated and
// mirrored grids.
#include "centroiding/slopes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "core/error.h"
#include "service/bench/bench_frames.h"

namespace curlew {
namespace {

struct OneLenslet {
  explicit OneLenslet(const Sensor& sensor) : plan(sensor), centroids(1, 1), slopes(1, 1) {
    centroids.state[0] = LensletState::kValid;
  }
  void displace(double dx, double dy) {
    centroids.x_px[0] = plan.ref_x_px[0] + static_cast<float>(dx);
    centroids.y_px[0] = plan.ref_y_px[0] + static_cast<float>(dy);
    measure_slopes(plan, centroids, slopes);
  }
  SlopePlan plan;
  Centroids centroids;
  SlopeField slopes;
};

// References near 8 px are floats, so that a displacement carries 5e-7 px of rounding.
constexpr double kRounding = 2e-6;

TEST(Slopes, AStraightGridGivesTheFormula) {
  Sensor sensor = tiled_sensor({1, 1, 16});
  sensor.optics = {.pitch_m = 300e-6,
                   .focal_m = 0.01,
                   .pixel_m = 5e-6,
                   .wavelength_m = 600e-9,
                   .magnification = 0.5,
                   .mirrored = false};
  // This is π rad.
  const double rad_per_px = 2 * std::numbers::pi * 300e-6 * 5e-6 / (600e-9 * 0.01 * 0.5);
  OneLenslet one(sensor);
  one.displace(0.25, -0.5);
  EXPECT_NEAR(one.slopes.x[0], 0.25 * rad_per_px, kRounding * rad_per_px);
  EXPECT_NEAR(one.slopes.y[0], -0.5 * rad_per_px, kRounding * rad_per_px);
  one.displace(0.0, 0.0);
  EXPECT_EQ(one.slopes.x[0], 0.0F);
  EXPECT_EQ(one.slopes.y[0], 0.0F);
}

TEST(Slopes, GainDividesDisplacementAndNoise) {
  Sensor sensor = tiled_sensor({1, 1, 16});
  sensor.gain_x[0] = 0.5F;
  OneLenslet one(sensor);
  one.centroids.variance_x_px2[0] = 0.01F;
  one.displace(0.25, 0.25);
  const double s = sensor.optics.slope_rad_per_px();
  EXPECT_NEAR(one.slopes.x[0], 0.5 * s, kRounding * s);
  EXPECT_NEAR(one.slopes.y[0], 0.25 * s, kRounding * s);
  EXPECT_NEAR(one.slopes.variance_x[0], 0.04 * s * s, 1e-6 * s * s);
}

// The slopes are resolved along the lenslet axes, whose rows run up the detector if sign is −1.
TEST(Slopes, RotationAndMirrorResolveAlongTheLensletAxes) {
  for (const double sign : {1.0, -1.0}) {
    const double angle = 0.3;
    Sensor sensor = tiled_sensor({1, 1, 16});
    sensor.grid.p11 = 16 * std::cos(angle);
    sensor.grid.p21 = 16 * std::sin(angle);
    sensor.grid.p12 = -sign * 16 * std::sin(angle);
    sensor.grid.p22 = sign * 16 * std::cos(angle);
    OneLenslet one(sensor);
    const double s = sensor.optics.slope_rad_per_px();
    // The spot moves along the column axis by 1 px, then along the row axis by 1 px.
    one.displace(std::cos(angle), std::sin(angle));
    EXPECT_NEAR(one.slopes.x[0], s, kRounding * s);
    EXPECT_NEAR(one.slopes.y[0], 0.0, kRounding * s);
    one.centroids.variance_x_px2[0] = 0.01F;
    one.centroids.variance_y_px2[0] = 0.03F;
    one.centroids.covariance_xy_px2[0] = 0.004F;
    one.displace(-sign * std::sin(angle), sign * std::cos(angle));
    EXPECT_NEAR(one.slopes.x[0], 0.0, kRounding * s);
    EXPECT_NEAR(one.slopes.y[0], s, kRounding * s);
    // The covariance becomes R·C·Rᵀ, where R is the inverse rotation, with the mirror's sign.
    const double c = std::cos(angle), n = std::sin(angle);
    const double s2 = s * s;
    EXPECT_NEAR(one.slopes.variance_x[0], (c * c * 0.01 + 2 * c * n * 0.004 + n * n * 0.03) * s2,
                1e-6 * s2);
    EXPECT_NEAR(one.slopes.variance_y[0], (n * n * 0.01 - 2 * c * n * 0.004 + c * c * 0.03) * s2,
                1e-6 * s2);
    EXPECT_NEAR(one.slopes.covariance_xy[0],
                sign * (c * n * (0.03 - 0.01) + (c * c - n * n) * 0.004) * s2, 1e-6 * s2);
  }
}

TEST(Slopes, AMissingLensletIsMissingAndNotZeroSlope) {
  OneLenslet one(tiled_sensor({1, 1, 16}));
  one.centroids.state[0] = LensletState::kFaint;
  one.displace(0.5, 0.5);
  EXPECT_EQ(one.slopes.valid[0], 0);
  EXPECT_EQ(one.slopes.n_valid, 0);
  EXPECT_EQ(one.slopes.x[0], 0.0F);
  EXPECT_EQ(one.slopes.variance_x[0], 0.0F);
}

TEST(Slopes, AClippedWindowIsLessSureTheFurtherItsSpotMoves) {
  // The error is half of the 20 % by which the gain lies below the others', times the 2 px that the
  // spot moves.
  Sensor sensor = tiled_sensor({1, 3, 16});
  sensor.gain_x[2] = 0.8F;
  const SlopePlan plan(sensor);
  Centroids centroids(1, 3);
  SlopeField slopes(1, 3);
  for (std::size_t k = 0; k < 3; ++k) {
    centroids.state[k] = LensletState::kValid;
    centroids.x_px[k] = sensor.ref_x_px[k] + 2.0F * sensor.gain_x[k];
    centroids.y_px[k] = sensor.ref_y_px[k] + 2.0F;
  }
  measure_slopes(plan, centroids, slopes);
  EXPECT_EQ(slopes.variance_x[1], 0.0F);
  EXPECT_EQ(slopes.variance_y[2], 0.0F);
  EXPECT_NEAR(std::sqrt(slopes.variance_x[2]) / slopes.x[2], 0.1F, 1e-5F);
}

TEST(Slopes, UnknownOpticsAreRefused) {
  Sensor sensor = tiled_sensor({1, 1, 16});
  sensor.optics.focal_m = kUnknown;
  EXPECT_THROW(SlopePlan{sensor}, Failure);
  sensor = tiled_sensor({1, 1, 16});
  sensor.ref_x_px[0] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW(SlopePlan{sensor}, Failure);
}

// Weak spots count in measure_weak_slopes() and are missing in measure_slopes().
TEST(WeakSlopes, AreTheSlopesOfWeakSpotsToo) {
  const Sensor sensor = tiled_sensor({1, 6, 16});
  const SlopePlan plan(sensor);
  Centroids centroids(1, 6);
  const LensletState states[] = {LensletState::kValid,     LensletState::kFaint,
                                 LensletState::kAtEdge,    LensletState::kFaint,
                                 LensletState::kSaturated, LensletState::kBadPixels};
  for (int c = 0; c < 6; ++c) {
    centroids.state(0, c) = states[c];
    const bool dark = c >= 3;
    centroids.flux_adu(0, c) = dark ? 0.0F : 50.0F;
    centroids.x_px(0, c) = dark ? 0.0F : plan.ref_x_px(0, c) + 0.5F;
    centroids.y_px(0, c) = dark ? 0.0F : plan.ref_y_px(0, c) - 0.25F;
    centroids.variance_x_px2(0, c) = dark || c == 2 ? 0.0F : 0.2F;
  }
  SlopeField strict(1, 6);
  SlopeField weak(1, 6);
  measure_slopes(plan, centroids, strict);
  measure_weak_slopes(plan, centroids, weak);
  SlopeField left(1, 6);
  leave_out_weak(centroids, weak, left);
  EXPECT_EQ(left.n_valid, strict.n_valid);
  for (std::size_t k = 0; k < strict.x.size(); ++k) {
    EXPECT_EQ(left.valid[k], strict.valid[k]);
    EXPECT_EQ(left.x[k], strict.x[k]);
    EXPECT_EQ(left.y[k], strict.y[k]);
    EXPECT_EQ(left.variance_x[k], strict.variance_x[k]);
    EXPECT_EQ(left.variance_y[k], strict.variance_y[k]);
    EXPECT_EQ(left.covariance_xy[k], strict.covariance_xy[k]);
  }
  EXPECT_EQ(strict.n_valid, 1);
  EXPECT_EQ(weak.n_valid, 4);
  const auto s = static_cast<float>(sensor.optics.slope_rad_per_px());
  EXPECT_EQ(weak.x(0, 0), strict.x(0, 0));
  EXPECT_EQ(weak.variance_x(0, 0), strict.variance_x(0, 0));
  for (const int c : {1, 2}) {
    EXPECT_EQ(strict.valid(0, c), 0);
    EXPECT_EQ(strict.x(0, c), 0.0F);
    EXPECT_EQ(weak.valid(0, c), 1);
    EXPECT_NEAR(weak.x(0, c), 0.5F * s, 1e-5F * s);
    EXPECT_NEAR(weak.y(0, c), -0.25F * s, 1e-5F * s);
    // A spot that lies on one column or row is known to the width of a spot, .42 λ/w.
    const float spot = plan.spot_variance_px2;
    EXPECT_NEAR(spot, std::pow(0.42 * 2.0 * std::numbers::pi / static_cast<double>(s), 2), 1e-4);
    EXPECT_NEAR(weak.variance_x(0, c), (c == 1 ? 0.2F : spot) * s * s, 1e-5F * s * s);
    EXPECT_NEAR(weak.variance_y(0, c), spot * s * s, 1e-5F * s * s);
  }
  // A weak spot is never less well known than a dark one.
  centroids.variance_x_px2(0, 1) = 1000.0F;
  measure_weak_slopes(plan, centroids, weak);
  EXPECT_EQ(weak.variance_x(0, 1), plan.window_variance(0, 1));
  EXPECT_EQ(weak.covariance_xy(0, 1), 0.0F);
  EXPECT_EQ(weak.valid(0, 3), 1);
  EXPECT_EQ(weak.x(0, 3), 0.0F);
  EXPECT_NEAR(weak.variance_x(0, 3), 16.0F * 16.0F * s * s / 12.0F, 1e-3F * s * s);
  for (const int c : {4, 5}) {
    EXPECT_EQ(weak.valid(0, c), 0);
    EXPECT_EQ(weak.variance_x(0, c), 0.0F);
  }
}

}  // namespace
}  // namespace curlew
