// This file declares the options of a tracker.
#pragma once

namespace curlew {

struct TrackerOptions {
  /// This is the mean number of false tracks confirmed a frame, if all candidates are clutter that
  /// comes independently in every frame, with the probabilities that its detector states. It must
  /// be more than 0.
  double false_tracks_per_frame = 0.003;
  /// A confirmed track is reported while it is at least this likely to be a vortex.
  double min_probability = 0.5;
  /// A candidate that is not confirmed is reported, without a track, if it is at least this likely.
  /// 1 reports none.
  double min_probability_single = 1.0;
  /// This weight multiplies a frame's evidence for or against a track. It must be in (0, 1]. It is
  /// below 1 because what misleads a detector lasts for some frames.
  double evidence_weight = 0.5;
  /// This part of the evidence in favour is still believed a frame later. It must be in (0, 1].
  double memory = 0.85;
  /// The detector's own opinion of a track is averaged over this many frames.
  double average_frames = 4.0;
  /// A track's score never exceeds this, because tracks must be able to end, too. It must be 2 or
  /// more.
  double max_score = 12.0;
  /// This is the rms, along an axis in pitches, of that part of the position errors which does not
  /// average out over the frames. It is added to the covariance that is reported.
  double lasting_error = 0.16;
  double unknown_error = 0.35;  ///< rms along an axis, pitches, if the detector states none
  /// Vortices move with the common drift and with a velocity of their own. These are the standard
  /// deviation of that velocity, in pitches a frame, and the number of frames that it lasts.
  double own_velocity = 0.03;
  double own_velocity_frames = 15.0;
  double wander = 0.04;  ///< rms of all other motion in a frame, pitches
  /// This is the standard deviation of the common drift before it is known, in pitches a frame.
  double max_drift = 0.15;
  /// A new vortex in the interior without an opposite one near is less likely than others by this
  /// factor.
  double lone_birth = 0.3;
  double longest_gap_frames = 20.0;  ///< after a longer gap all begins anew
};

/// Throws UsageError where an option is out of its range.
void check_tracker_options(const TrackerOptions& options);

}  // namespace curlew
