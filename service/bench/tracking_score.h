// Tracking scores: what was reported, frame after frame, against vortices whose identities are
// known.
#pragma once

#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "service/bench/detection_score.h"

namespace curlew {

struct TrueVortex {
  GradedVortex vortex;
  int identity = 0;
  /// Velocity in pitches a frame, from the frames before and after; NaN if the vortex is in
  /// neither.
  double velocity_x = std::numeric_limits<double>::quiet_NaN();
  double velocity_y = std::numeric_limits<double>::quiet_NaN();
};

struct ReportedVortex {
  double x = 0.0;  ///< lenslet units
  double y = 0.0;
  int charge = 0;
  std::int64_t track = -1;                                       ///< −1: none
  double velocity_x = std::numeric_limits<double>::quiet_NaN();  ///< pitches a frame; NaN: unknown
  double velocity_y = std::numeric_limits<double>::quiet_NaN();
};

/// Counts over some frames. They are sums, so that those of several sequences can be added.
struct TrackingCounts {
  double frames = 0;
  double required = 0;      ///< required vortices in the interior
  double hits = 0;          ///< required vortices that were hit
  double false_alarms = 0;  ///< reported vortices that count and hit nothing
  double switches = 0;      ///< hits by another track than the one that hit this vortex before
  /// Tracks that count but never hit any vortex, counted in their first frame.
  double false_tracks = 0;
  double error2 = 0;  ///< squared distances of hits, pitches²
  double velocity_hits = 0;
  double velocity_error2 = 0;  ///< (pitches a frame)²
  double consistent_hits = 0;  ///< hits by the one track that is paired with the vortex

  double misses() const { return required - hits; }
  double f1() const { return 2.0 * hits / (required + hits + false_alarms); }
  /// The accuracy 1 − (misses + false alarms + switches)/required (K. Bernardin and R.
  /// Stiefelhagen, EURASIP J. Image Video Process. 2008, 246309).
  double accuracy() const { return 1.0 - (misses() + false_alarms + switches) / required; }
  double rms() const;           ///< pitches
  double velocity_rms() const;  ///< pitches a frame
  /// The F1 of identities: each vortex is paired with at most one track, and each track with at
  /// most one vortex, so that most hits agree (E. Ristani et al., ECCV Workshops 2016).
  double identity_f1() const { return 2.0 * consistent_hits / (required + hits + false_alarms); }

  TrackingCounts& operator+=(const TrackingCounts& other);
};

/// Scores the frames of one sequence. Returns the counts of each frame. A reported vortex hits a
/// required true one of its charge in the interior within kHitRadius, one to one: first the track
/// that hit it last, then the nearest pairs. A reported vortex that hits none does not count if it
/// lies outside the interior, or within kHitRadius of a true one of its charge that is not required
/// or not in the interior.
std::vector<TrackingCounts> score_tracks(std::span<const std::vector<TrueVortex>> truth,
                                         std::span<const std::vector<ReportedVortex>> reported,
                                         const Interior& interior);

/// Returns the true vortices of each frame, graded, identified and with velocities, from all steps
/// of a sequence.
std::vector<std::vector<TrueVortex>> true_vortices(std::span<const std::vector<SceneVortex>> steps,
                                                   int steps_per_frame);

}  // namespace curlew
