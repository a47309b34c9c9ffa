#include "detect/tracking/vortex_motion.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <array>
#include <cmath>

namespace curlew {
namespace {

constexpr float kFrameS = 2e-3F;

const Eigen::Matrix2f kErrors{{0.04F, 0.01F}, {0.01F, 0.09F}};

TEST(VortexMotion, TwoMeasurementsOfOnePlaceAreWeightedByTheirInverseCovariances) {
  const Eigen::Matrix2f others{{0.02F, -0.01F}, {-0.01F, 0.03F}};
  const Eigen::Vector2f a(3.0F, 4.0F), b(3.2F, 3.9F);
  const VortexMotion motion({});
  MotionState state = motion.begin(a, kErrors);
  const Innovation innovation = state.innovation(b, others);
  const Eigen::Matrix2f sum = kErrors + others;
  EXPECT_NEAR(innovation.mahalanobis2, (b - a).dot(sum.inverse() * (b - a)), 1e-5F);
  EXPECT_NEAR(innovation.determinant, sum.determinant(), 1e-7F);
  state.update(innovation);
  const Eigen::Matrix2f covariance = (kErrors.inverse() + others.inverse()).inverse();
  const Eigen::Vector2f mean = covariance * (kErrors.inverse() * a + others.inverse() * b);
  const Eigen::Vector2f found = state.mean.head<2>();
  const Eigen::Matrix2f found_covariance = state.covariance.topLeftCorner<2, 2>();
  EXPECT_LT((found - mean).norm(), 1e-5F);
  EXPECT_LT((found_covariance - covariance).norm(), 1e-6F);
}

TEST(VortexMotion, BeforeTheDriftIsKnownVelocitiesLast) {
  TrackerOptions options;
  VortexMotion motion(options);
  motion.learn_interval(kFrameS);
  MotionState state = motion.begin({5.0F, 6.0F}, kErrors);
  state.mean(2) = 10.0F;
  const float velocity_variance = state.covariance(2, 2);
  state.predict(motion.step(3.0F * kFrameS));
  EXPECT_NEAR(state.x(), 5.0F + 10.0F * 3.0F * kFrameS, 1e-5F);
  EXPECT_EQ(state.y(), 6.0F);
  EXPECT_EQ(state.mean(2), 10.0F);
  const auto wander = static_cast<float>(options.wander);
  EXPECT_NEAR(
      state.covariance(0, 0),
      kErrors(0, 0) + 3.0F * wander * wander + std::pow(3.0F * kFrameS, 2.0F) * velocity_variance,
      1e-5F);
}

TEST(VortexMotion, WhatMovesOnItsOwnFallsBackToTheDrift) {
  const TrackerOptions options;
  VortexMotion motion(options);
  motion.learn_interval(kFrameS);
  for (int frame = 0; frame < 200; ++frame) {
    // There are outliers on both sides.
    std::array<float, 5> x = {7.0F, -90.0F, 8.0F, 300.0F, 7.5F};
    std::array<float, 5> y = {-2.0F, -2.0F, -2.0F, 40.0F, -50.0F};
    motion.learn_drift(x, y);
  }
  EXPECT_NEAR(motion.drift().x(), 7.5F, 1e-3F);
  EXPECT_NEAR(motion.drift().y(), -2.0F, 1e-3F);
  MotionState state = motion.begin({5.0F, 6.0F}, kErrors);
  state.mean(2) = 20.0F;
  for (int frame = 0; frame < 200; ++frame) state.predict(motion.step(kFrameS));
  EXPECT_NEAR(state.mean(2), 7.5F, 0.01F);
  // The variance of a vortex's own velocity is renewed as fast as it dies away.
  const auto own = static_cast<float>(options.own_velocity) / kFrameS;
  EXPECT_NEAR(state.covariance(2, 2), own * own, 0.01F * own * own);
}

}  // namespace
}  // namespace curlew
