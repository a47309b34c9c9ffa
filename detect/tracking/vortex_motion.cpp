#include "detect/tracking/vortex_motion.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "core/median.h"

namespace curlew {
namespace {

float square(float x) noexcept { return x * x; }

}  // namespace

void MotionState::predict(const MotionStep& step) noexcept {
  mean.head<2>() += step.dt * mean.tail<2>();
  mean.tail<2>() = step.stays * mean.tail<2>() + (1.0F - step.stays) * step.drift;
  const Eigen::Matrix2f cross = covariance.topRightCorner<2, 2>();
  const Eigen::Matrix2f velocity = covariance.bottomRightCorner<2, 2>();
  covariance.topLeftCorner<2, 2>() += step.dt * (cross + cross.transpose()) +
                                      square(step.dt) * velocity +
                                      step.wander * Eigen::Matrix2f::Identity();
  covariance.topRightCorner<2, 2>() = step.stays * (cross + step.dt * velocity);
  covariance.bottomLeftCorner<2, 2>() = covariance.topRightCorner<2, 2>().transpose();
  covariance.bottomRightCorner<2, 2>() =
      square(step.stays) * velocity + step.renewed * Eigen::Matrix2f::Identity();
}

Innovation MotionState::innovation(const Eigen::Vector2f& position,
                                   const Eigen::Matrix2f& position_covariance) const noexcept {
  const Eigen::Vector2f off = position - mean.head<2>();
  const Eigen::Matrix2f spread = covariance.topLeftCorner<2, 2>() + position_covariance;
  const Eigen::Matrix2f inverse = spread.inverse();
  return {off, inverse, spread.determinant(), off.dot(inverse * off)};
}

void MotionState::update(const Innovation& innovation) noexcept {
  const Eigen::Matrix<float, 4, 2> gain = covariance.leftCols<2>() * innovation.inverse;
  mean += gain * innovation.off;
  covariance -= (gain * covariance.topRows<2>()).eval();
  covariance = (0.5F * (covariance + covariance.transpose())).eval();
}

VortexMotion::VortexMotion(const TrackerOptions& options)
    : own_velocity_(static_cast<float>(options.own_velocity)),
      own_velocity_frames_(static_cast<float>(options.own_velocity_frames)),
      wander_(static_cast<float>(options.wander)),
      max_drift_(static_cast<float>(options.max_drift)) {}

void VortexMotion::reset() noexcept {
  interval_s_ = 0.0F;
  drift_.setZero();
  drift_known_ = 0.0F;
}

void VortexMotion::learn_interval(float dt) noexcept {
  if (interval_s_ == 0.0F) interval_s_ = dt;
  interval_s_ += 0.05F * (std::clamp(dt, 0.5F * interval_s_, 2.0F * interval_s_) - interval_s_);
}

/// Moves the drift towards the median velocity.
void VortexMotion::learn_drift(std::span<float> along_x, std::span<float> along_y) noexcept {
  const Eigen::Vector2f now(median_of(along_x), median_of(along_y));
  // The drift is learnt fast at first; then it is an average over some 20 frames.
  const float gain = std::max(0.05F, 1.0F - drift_known_);
  drift_ += gain * (now - drift_);
  drift_known_ += 0.1F * (1.0F - drift_known_);
}

MotionState VortexMotion::begin(const Eigen::Vector2f& position,
                                const Eigen::Matrix2f& covariance) const noexcept {
  MotionState state;
  state.mean << position, drift_;
  state.covariance.topLeftCorner<2, 2>() = covariance;
  const float velocity = square(own_velocity_) + (1.0F - drift_known_) * square(max_drift_);
  // Before the second frame it is not known how long a frame is.
  state.covariance(2, 2) = state.covariance(3, 3) =
      interval_s_ > 0.0F ? velocity / square(interval_s_) : 0.0F;
  return state;
}

void VortexMotion::doubt_velocity(MotionState& state) const noexcept {
  state.covariance.bottomRightCorner<2, 2>() =
      square(max_drift_ / interval_s_) * Eigen::Matrix2f::Identity();
}

// A vortex's own velocity dies away, and noise renews it so that its variance stays the same.
MotionStep VortexMotion::step(float dt) const noexcept {
  const float frames = dt / interval_s_;
  const float stays =
      drift_known_ * std::exp(-frames / own_velocity_frames_) + (1.0F - drift_known_);
  const float renewed = square(own_velocity_ / interval_s_) *
                        (1.0F - std::exp(-2.0F * frames / own_velocity_frames_));
  return {dt, stays, renewed, square(wander_) * frames, drift_};
}

}  // namespace curlew
