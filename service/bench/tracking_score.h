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
  /// Pitches a frame, from the frames around; NaN where it is in neither.
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

/// Counts of some frames. Sums, so that those of several sequences add up.
struct TrackingCounts {
  double frames = 0;
  double required = 0;      ///< required vortices in the interior
  double hits = 0;          ///< of these
  double false_alarms = 0;  ///< reported ones that count and hit nothing
  double switches = 0;      ///< hits by another track than the one that hit this vortex before
  double false_tracks = 0;  ///< tracks that count but never hit any vortex, in their first frame
  double error2 = 0;        ///< of hits, pitches²
  double velocity_hits = 0;
  double velocity_error2 = 0;  ///< (pitches a frame)²
  double consistent_hits = 0;  ///< identities: hits by the one track that is the vortex's own

  double misses() const { return required - hits; }
  double f1() const { return 2.0 * hits / (required + hits + false_alarms); }
  /// 1 − (misses + false alarms + switches)/required (K. Bernardin and R. Stiefelhagen, EURASIP J.
  /// Image Video Process. 2008, 246309).
  double accuracy() const { return 1.0 - (misses() + false_alarms + switches) / required; }
  double rms() const;           ///< pitches
  double velocity_rms() const;  ///< pitches a frame
  /// The F1 of identities: each vortex paired with at most one track and the other way round, so
  /// that most hits agree (E. Ristani et al., ECCV Workshops 2016).
  double identity_f1() const { return 2.0 * consistent_hits / (required + hits + false_alarms); }

  TrackingCounts& operator+=(const TrackingCounts& other);
};

/// The frames of one sequence: [frames] of counts. A reported vortex hits a required true one of
/// its charge in the interior within kHitRadius, one to one: first whoever hit it last, then the
/// nearest pairs. Others do not count where they lie outside the interior, or within kHitRadius of
/// a true one of their charge that is not required or not in the interior.
std::vector<TrackingCounts> score_tracks(std::span<const std::vector<TrueVortex>> truth,
                                         std::span<const std::vector<ReportedVortex>> reported,
                                         const Interior& interior);

/// Graded, identified, with their velocities: frame by frame from all steps of a sequence.
std::vector<std::vector<TrueVortex>> true_vortices(std::span<const std::vector<SceneVortex>> steps,
                                                   int steps_per_frame);

}  // namespace curlew
