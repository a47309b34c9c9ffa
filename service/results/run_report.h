// RunReport: what a run of the pipeline counted and how long it took, and sentences on it.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "centroiding/window_follower.h"
#include "core/centroids.h"
#include "core/latency_histogram.h"
#include "service/stages.h"

namespace curlew {

/// The latencies of a run, and what was counted on the way.
struct RunReport {
  std::int64_t frames = 0;
  std::int64_t vortices = 0;
  std::int64_t overflow = 0;       ///< vortices that found no room in the list
  std::int64_t dropped = 0;        ///< frames missing in the numbering of those that came
  std::int64_t late = 0;           ///< frames whose results missed the deadline
  std::int64_t not_converged = 0;  ///< frames whose split stopped at its iteration limit
  std::int64_t measured = 0;       ///< valid lenslets, over all frames
  std::int64_t lenslets = 0;       ///< lit lenslets of the sensor, over all frames
  std::int64_t in_islands = 0;     ///< frames whose phase has several large islands
  std::int64_t too_blurred = 0;    ///< frames with wider spots than the classifier was taught
  /// How many frames each FollowState had, and how often lenslets were kLost; for frames whose
  /// windows follow the spots.
  std::array<std::int64_t, kFollowStates> followed{};
  std::int64_t lost = 0;
  /// How often the plan's lenslets were in each LensletState, in the frames before the first that
  /// has a valid one.
  std::array<std::int64_t, kLensletStates> unmeasured{};
  std::array<LatencyHistogram, kStageCount> stage;
  LatencyHistogram publish;
  LatencyHistogram total;
  double seconds = 0.0;

  void merge(const RunReport& other);
};

/// Returns a sentence on why nothing was measured in the frames of a run, the most frequent reasons
/// first; empty if at least one lenslet of one frame was valid, or if there was no frame.
std::string nothing_measured(const RunReport& report);

/// Returns a sentence on where the spots were and how many were lost; empty if all were where the
/// windows are.
std::string followed_text(const RunReport& report);

/// Returns sentences on what makes phase and vortices of the run less sure than they look: many
/// lenslets without a slope, spots that the classifier does not know, and phase in several islands.
std::vector<std::string> doubts(const RunReport& report);

/// Returns how many vortices were found, as "3 vortices", or "nothing measured".
std::string found_text(const RunReport& report);

}  // namespace curlew
