// How a tracker is set.
#pragma once

namespace curlew {

struct TrackerOptions {
  /// Mean number of false tracks confirmed a frame where all candidates are clutter that comes
  /// independently in every frame, with the probabilities its detector states. More than 0.
  double false_tracks_per_frame = 0.003;
  /// A confirmed track is reported while it is at least this likely to be a vortex.
  double min_probability = 0.5;
  /// What is not confirmed is reported, without a track, if it is this likely; 1: never.
  double min_probability_single = 1.0;
  /// What a frame's evidence for or against a track counts, in (0, 1]. Below 1 because what
  /// misleads a detector lasts for some frames.
  double evidence_weight = 0.5;
  /// The part of the evidence in favour that is still believed a frame later, in (0, 1].
  double memory = 0.85;
  double average_frames = 4.0;  ///< that the detector's own opinion of a track is averaged over
  /// 2 or more; evidence beyond is forgotten at once, for tracks must end too.
  double max_score = 12.0;
  /// rms along an axis, pitches, of that part of the position errors that does not average out over
  /// the frames; added to the covariance that is reported.
  double lasting_error = 0.16;
  double unknown_error = 0.35;  ///< rms along an axis, pitches, where the detector states none
  /// Vortices move with the common drift but for a velocity of their own: its standard deviation,
  /// pitches a frame, and the frames it lasts.
  double own_velocity = 0.03;
  double own_velocity_frames = 15.0;
  double wander = 0.04;     ///< rms of what else moves them in a frame, pitches
  double max_drift = 0.15;  ///< standard deviation of the common drift before it is known, pitches
  /// Interior births without an opposite one near are this much less likely than others.
  double lone_birth = 0.3;
  double longest_gap_frames = 20.0;  ///< after a longer one all begins anew
};

/// Throws UsageError on options out of range.
void check_tracker_options(const TrackerOptions& options);

}  // namespace curlew
