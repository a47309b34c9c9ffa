// How vortices move, and where they are by all that was seen of them: a Kalman filter each.
#pragma once

#include <Eigen/Core>
#include <span>

#include "detect/tracking/tracker_options.h"

namespace curlew {

/// What some time does to every vortex.
struct MotionStep {
  float dt;       ///< s
  float stays;    ///< part of a velocity of its own
  float renewed;  ///< its variance
  float wander;   ///< variance, pitches²
  Eigen::Vector2f drift;
};

/// What a measured position says beyond the predicted one.
struct Innovation {
  Eigen::Vector2f off;      ///< measured less predicted, pitches
  Eigen::Matrix2f inverse;  ///< of its covariance S
  float determinant;        ///< of S
  float mahalanobis2;       ///< offᵀ·S⁻¹·off: χ² with two degrees of freedom
};

/// Of one vortex, at the time of a frame.
struct MotionState {
  /// x, y in pitches; velocity in pitches a second.
  Eigen::Vector4f mean = Eigen::Vector4f::Zero();
  Eigen::Matrix4f covariance = Eigen::Matrix4f::Zero();

  float x() const { return mean.x(); }
  float y() const { return mean.y(); }

  void predict(const MotionStep& step) noexcept;
  /// position_covariance: of the position's errors, pitches².
  Innovation innovation(const Eigen::Vector2f& position,
                        const Eigen::Matrix2f& position_covariance) const noexcept;
  void update(const Innovation& innovation) noexcept;
};

/// All vortices drift together, each with a velocity of its own besides that dies away. The drift
/// and the time from frame to frame are learnt.
class VortexMotion {
 public:
  /// Uses own_velocity, own_velocity_frames, wander and max_drift.
  explicit VortexMotion(const TrackerOptions& options);

  void reset() noexcept;

  /// From frame to frame; 0 until known.
  float interval_s() const { return interval_s_; }
  void learn_interval(float dt) noexcept;

  /// Pitches a second; 0 while unknown.
  const Eigen::Vector2f& drift() const { return drift_; }
  /// From the velocities, at least one, of vortices that have been followed for some frames. Sorts
  /// them.
  void learn_drift(std::span<float> along_x, std::span<float> along_y) noexcept;

  /// Of a vortex that is seen for the first time.
  MotionState begin(const Eigen::Vector2f& position,
                    const Eigen::Matrix2f& covariance) const noexcept;
  /// Now that interval_s is known: of what began before it was.
  void doubt_velocity(MotionState& state) const noexcept;

  MotionStep step(float dt) const noexcept;

 private:
  float own_velocity_;
  float own_velocity_frames_;
  float wander_;
  float max_drift_;

  float interval_s_ = 0;
  Eigen::Vector2f drift_ = Eigen::Vector2f::Zero();
  float drift_known_ = 0;  // 0 … 1
};

}  // namespace curlew
