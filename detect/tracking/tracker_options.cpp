#include "detect/tracking/tracker_options.h"

#include <cmath>

#include "core/error.h"

namespace curlew {

void check_tracker_options(const TrackerOptions& o) {
  const auto part = [](double x) { return x > 0.0 && x <= 1.0; };
  const auto positive = [](double x) { return std::isfinite(x) && x > 0.0; };
  if (!positive(o.false_tracks_per_frame))
    throw UsageError("false tracks a frame must be a number above 0, such as 0.001");
  if (!part(o.min_probability) || !part(o.min_probability_single))
    throw UsageError("a track's least probability must be above 0 and at most 1");
  if (!part(o.evidence_weight) || !part(o.memory) || !part(o.lone_birth))
    throw UsageError("a tracker's weights must be above 0 and at most 1");
  if (!(o.max_score >= 2.0) || !(o.lasting_error >= 0.0) || !(o.average_frames >= 1.0) ||
      !positive(o.unknown_error) || !positive(o.own_velocity) || !positive(o.own_velocity_frames) ||
      !positive(o.wander) || !positive(o.max_drift) || !positive(o.longest_gap_frames))
    throw UsageError(
        "a tracker's errors, speeds and times must be above 0, its largest score 2 or more");
}

}  // namespace curlew
