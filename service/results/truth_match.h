// The truth of simulated recordings, and its comparison with what was found.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "acquisition/recording/frame_selection.h"
#include "acquisition/recording/truth_vortex.h"
#include "acquisition/simulator/field.h"
#include "core/vortex.h"

namespace curlew {

/// The true vortices of recordings that follow one another. Frames are counted over all of them.
class Truth {
 public:
  /// selection: what is read of each recording.
  explicit Truth(const std::vector<std::string>& recordings, const FrameSelection& selection = {});

  bool known() const { return known_; }  ///< whether at least one recording has a truth
  std::span<const TruthVortex> of_frame(std::int64_t frame) const;

 private:
  bool known_ = false;
  std::vector<TruthVortex> vortices_;
};

/// A found vortex hits a true one of the same sign within this many pitches, as in the benchmark.
inline constexpr double kHitRadius = 0.75;

struct TruthMatch {
  std::vector<int> truth_of_found;  ///< index into truth; −1: a false alarm
  int hits = 0;
};

/// Matches found vortices with true ones, one to one, the nearest pairs first.
TruthMatch match_truth(std::span<const Vortex> found, std::span<const TruthVortex> truth);

/// Two opposite vortices closer than this many pitches are not required of a detector.
inline constexpr double kClosestRequiredPair = 1.0;
/// A vortex is isolated if it is farther than this from every other, in pitches.
inline constexpr double kIsolation = 2.0;

struct GradedVortex {
  double x = 0.0;  ///< lenslet units
  double y = 0.0;
  int charge = 0;
  /// false: a detector is neither blamed for missing it nor credited for finding it
  bool required = true;
  bool isolated = true;
};

/// Grades the vortices of one field, in their order. The closest opposite pair is removed, again
/// and again, until none is closer than kClosestRequiredPair; what is left is required. Give the
/// vortices beyond the array too, or pairs across its edge are torn apart.
std::vector<GradedVortex> grade_vortices(std::span<const SceneVortex> vortices);

}  // namespace curlew
