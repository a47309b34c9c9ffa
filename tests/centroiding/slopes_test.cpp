// These tests compare slopes with the formula of docs/conventions.md, on straight, rotated and
// mirrored grids.
#include "centroiding/slopes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <utility>

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

TEST(Slopes, ABentGainIsThatOfThePlaceInTheWindow) {
  Sensor sensor = tiled_sensor({1, 1, 16});
  const auto map = [](float value) { return Image<float>(1, 1, value); };
  sensor.gain_x[0] = 0.8F;
  sensor.bend2_x = map(0.1F);
  sensor.bend3_x = map(0.3F);
  sensor.bend2_y = sensor.bend3_y = map(0.0F);
  OneLenslet one(sensor);
  one.centroids.variance_x_px2[0] = 0.01F;
  one.displace(0.5, 0.25);
  const double s = sensor.optics.slope_rad_per_px();
  EXPECT_NEAR(one.slopes.x[0], (0.5 / 0.8 + 0.1 * 0.25 + 0.3 * 0.125) * s, kRounding * s);
  EXPECT_NEAR(one.slopes.y[0], 0.25 * s, kRounding * s);
  // The noise passes through the curve's slope at this place.
  const double slope = 1.25 + 2.0 * 0.1 * 0.5 + 3.0 * 0.3 * 0.25;
  EXPECT_NEAR(one.slopes.variance_x[0], 0.01 * slope * slope * s * s, 1e-6 * s * s);
  // Beyond the reach the curve goes on as a line.
  const double reach = 0.75;
  one.displace(2.6, 0.0);
  EXPECT_NEAR(one.slopes.x[0], (2.6 / 0.8 + 0.1 * reach * reach + 0.3 * reach * reach * reach) * s,
              10.0 * kRounding * s);
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

/// Returns the slope, variances and covariance of one lenslet by the plain formula, without
/// vectors.
std::array<float, 5> plain_slope(const SlopePlan& plan, const Centroids& centroids, std::size_t k) {
  const LensletState state = centroids.state[k];
  const bool soft = state == LensletState::kFaint || state == LensletState::kAtEdge;
  const bool weak = soft && centroids.flux_adu[k] > 0.0F;
  const bool dark = soft && !weak;
  if (state != LensletState::kValid && !soft) return {};
  const auto noise = [&](float measured) {
    return weak && !(measured > 0.0F) ? plan.spot_variance_px2 : measured;
  };
  struct Axis {
    float d, v, g;
  };
  const auto along = [&](float at, float ref, float off, float moved, float low, float g1, float b2,
                         float b3, float error, float variance) -> Axis {
    if (dark) return {low, 0.0F, 0.0F};
    const float q = at - ref - moved;
    const float near = std::min(std::max(q + off, -plan.reach_px), plan.reach_px) - off;
    const float in_window = q * g1 + near * near * (b2 + b3 * near);
    const float slope = std::max(g1 + near * (2.0F * b2 + 3.0F * (b3 * near)), 0.0F);
    const float e = error * in_window;
    return {in_window + moved, variance * slope * slope + e * e, slope};
  };
  const auto [dx, vx, gx] =
      along(centroids.x_px[k], plan.ref_x_px[k], plan.off_x_px[k], centroids.moved_x_px[k],
            centroids.low_x_px[k], plan.inverse_gain_x[k], plan.bend2_x[k], plan.bend3_x[k],
            plan.gain_error_x[k], noise(centroids.variance_x_px2[k]));
  const auto [dy, vy, gy] =
      along(centroids.y_px[k], plan.ref_y_px[k], plan.off_y_px[k], centroids.moved_y_px[k],
            centroids.low_y_px[k], plan.inverse_gain_y[k], plan.bend2_y[k], plan.bend3_y[k],
            plan.gain_error_y[k], noise(centroids.variance_y_px2[k]));
  const float c = centroids.covariance_xy_px2[k] * gx * gy;
  const float m11 = plan.m11, m12 = plan.m12, m21 = plan.m21, m22 = plan.m22;
  float variance_x = m11 * m11 * vx + 2.0F * m11 * m12 * c + m12 * m12 * vy;
  float variance_y = m21 * m21 * vx + 2.0F * m21 * m22 * c + m22 * m22 * vy;
  float covariance = m11 * m21 * vx + (m11 * m22 + m12 * m21) * c + m12 * m22 * vy;
  const float maximum = plan.window_variance[k];
  if (weak && std::max(variance_x, variance_y) > maximum) {
    variance_x = std::min(variance_x, maximum);
    variance_y = std::min(variance_y, maximum);
    covariance = 0.0F;
  }
  const float of_dark = dark ? maximum : 0.0F;
  return {m11 * dx + m12 * dy, m21 * dx + m22 * dy, of_dark + variance_x, of_dark + variance_y,
          covariance};
}

// Arrays smaller than a vector, of whole vectors, and with a rest.
TEST(AllSlopes, AreBitForBitThePlainFormula) {
  std::mt19937 random(31);
  std::normal_distribution<float> normal;
  for (const auto& [rows, cols] : {std::pair{1, 3}, {3, 7}, {8, 8}, {13, 11}}) {
    Sensor sensor = tiled_sensor({rows, cols, 10});
    sensor.grid.p12 = 0.3;
    sensor.spot_sigma_px = 1.1;
    for (float& gain : sensor.gain_x) gain = 1.0F - 0.2F * std::abs(normal(random));
    for (const auto bend :
         {&Sensor::bend2_x, &Sensor::bend2_y, &Sensor::bend3_x, &Sensor::bend3_y}) {
      sensor.*bend = Image<float>(rows, cols);
      for (float& value : sensor.*bend) value = 0.2F * normal(random);
    }
    const SlopePlan plan(sensor);
    Centroids centroids(rows, cols);
    for (std::size_t k = 0; k < centroids.state.size(); ++k) {
      centroids.state[k] = static_cast<LensletState>(random() % kLensletStates);
      centroids.x_px[k] = plan.ref_x_px[k] + normal(random);
      centroids.y_px[k] = plan.ref_y_px[k] + normal(random);
      centroids.flux_adu[k] = std::max(0.0F, 50.0F * normal(random) + 20.0F);
      centroids.xx_px2[k] = 1.2F + 0.3F * normal(random);
      centroids.yy_px2[k] = 1.2F + 0.3F * normal(random);
      centroids.variance_x_px2[k] = std::max(0.0F, 0.1F * normal(random));
      centroids.variance_y_px2[k] = std::max(0.0F, 9.0F * normal(random));
      centroids.covariance_xy_px2[k] = 0.01F * normal(random);
      centroids.low_x_px[k] = normal(random);
      centroids.low_y_px[k] = normal(random);
      centroids.moved_x_px[k] = std::round(normal(random));
      centroids.moved_y_px[k] = std::round(normal(random));
    }
    SlopeField weak(rows, cols);
    SlopeField strict(rows, cols);
    measure_all_slopes(plan, centroids, weak, strict);
    int n_weak = 0;
    int n_strict = 0;
    for (std::size_t k = 0; k < centroids.state.size(); ++k) {
      SCOPED_TRACE(k);
      const auto [x, y, variance_x, variance_y, covariance] = plain_slope(plan, centroids, k);
      const bool valid = centroids.state[k] == LensletState::kValid;
      const bool any = valid || centroids.state[k] == LensletState::kFaint ||
                       centroids.state[k] == LensletState::kAtEdge;
      const float low_x = any ? centroids.low_x_px[k] : 0.0F;
      const float low_y = any ? centroids.low_y_px[k] : 0.0F;
      EXPECT_EQ(weak.x[k], x - (plan.m11 * low_x + plan.m12 * low_y));
      EXPECT_EQ(weak.y[k], y - (plan.m21 * low_x + plan.m22 * low_y));
      EXPECT_EQ(weak.variance_x[k], variance_x);
      EXPECT_EQ(weak.variance_y[k], variance_y);
      EXPECT_EQ(weak.covariance_xy[k], covariance);
      EXPECT_EQ(weak.valid[k], any ? 1 : 0);
      EXPECT_EQ(strict.x[k], valid ? x : 0.0F);
      EXPECT_EQ(strict.y[k], valid ? y : 0.0F);
      EXPECT_EQ(strict.variance_y[k], valid ? variance_y : 0.0F);
      EXPECT_EQ(strict.valid[k], valid ? 1 : 0);
      n_weak += any ? 1 : 0;
      n_strict += valid ? 1 : 0;
    }
    EXPECT_EQ(weak.n_valid, n_weak);
    EXPECT_EQ(strict.n_valid, n_strict);
  }
}

}  // namespace
}  // namespace curlew
