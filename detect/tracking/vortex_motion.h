// This file declares how vortices move. A Kalman filter for each vortex gives its place from all
// that was seen of it.
#pragma once

#include <Eigen/Core>
#include <span>

#include "detect/tracking/tracker_options.h"

namespace curlew {

/// Holds what a step of time does to every vortex.
struct MotionStep {
  float dt;       ///< time, s
  float stays;    ///< part of a vortex's own velocity that stays
  float renewed;  ///< variance added to the velocity, (pitches/s)²
  float wander;   ///< variance added to the position, pitches²
  Eigen::Vector2f drift;
};

/// Holds what a measured position adds to the predicted one.
struct Innovation {
  Eigen::Vector2f off;      ///< measured less predicted position, pitches
  Eigen::Matrix2f inverse;  ///< inverse of the covariance S of `off`
  float determinant;        ///< determinant of S
  float mahalanobis2;       ///< offᵀ·S⁻¹·off, χ² with two degrees of freedom
};

/// This is the state of one vortex at the time of a frame.
struct MotionState {
  /// The mean holds x and y in pitches, then the velocity in pitches a second.
  Eigen::Vector4f mean = Eigen::Vector4f::Zero();
  Eigen::Matrix4f covariance = Eigen::Matrix4f::Zero();

  float x() const { return mean.x(); }
  float y() const { return mean.y(); }

  void predict(const MotionStep& step) noexcept;
  /// position_covariance is that of the errors of the measured position, in pitches².
  Innovation innovation(const Eigen::Vector2f& position,
                        const Eigen::Matrix2f& position_covariance) const noexcept;
  void update(const Innovation& innovation) noexcept;
};

/// All vortices drift together. Each also has a velocity of its own, which dies away. The drift and
/// the time from frame to frame are learnt.
class VortexMotion {
 public:
  /// The options used are own_velocity, own_velocity_frames, wander and max_drift.
  explicit VortexMotion(const TrackerOptions& options);

  void reset() noexcept;

  /// Returns the time from frame to frame, and 0 until it is known.
  float interval_s() const { return interval_s_; }
  void learn_interval(float dt) noexcept;

  /// Returns the drift in pitches a second, and 0 while it is not known.
  const Eigen::Vector2f& drift() const { return drift_; }
  /// Learns from the velocities, at least one, of vortices that have been followed for some frames.
  /// The function sorts them.
  void learn_drift(std::span<float> along_x, std::span<float> along_y) noexcept;

  /// Returns the state of a vortex that is seen for the first time.
  MotionState begin(const Eigen::Vector2f& position,
                    const Eigen::Matrix2f& covariance) const noexcept;
  /// Widens the velocity's variance of a state that began before interval_s was known, now that it
  /// is.
  void doubt_velocity(MotionState& state) const noexcept;

  MotionStep step(float dt) const noexcept;

 private:
  float own_velocity_;
  float own_velocity_frames_;
  float wander_;
  float max_drift_;

  float interval_s_ = 0;
  Eigen::Vector2f drift_ = Eigen::Vector2f::Zero();
  float drift_known_ = 0;  // from 0 to 1
};

}  // namespace curlew
