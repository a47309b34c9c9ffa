// The truth of simulated recordings, and what was found held against it.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "acquisition/recording/truth_vortex.h"
#include "acquisition/simulator/field.h"
#include "core/vortex.h"

namespace curlew {

/// The true vortices of recordings that follow one another, by frame over all of them.
class Truth {
 public:
  explicit Truth(const std::vector<std::string>& recordings);

  bool known() const { return known_; }  ///< at least one recording has a truth
  std::span<const TruthVortex> of_frame(std::int64_t frame) const;

 private:
  bool known_ = false;
  std::vector<TruthVortex> vortices_;
};

/// A found vortex hits a true one of the same sign within this many pitches (the benchmark's rule).
inline constexpr double kHitRadius = 0.75;

struct TruthMatch {
  std::vector<int> truth_of_found;  ///< index into truth, −1 for a false alarm
  int hits = 0;
};

/// One to one, nearest pairs first.
TruthMatch match_truth(std::span<const Vortex> found, std::span<const TruthVortex> truth);

/// Opposite vortices nearer each other than this many pitches cannot be asked of a detector.
inline constexpr double kClosestRequiredPair = 1.0;
/// A vortex farther than this from every other is isolated, pitches.
inline constexpr double kIsolation = 2.0;

struct GradedVortex {
  double x = 0.0;  ///< lenslet units
  double y = 0.0;
  int charge = 0;
  bool required = true;  ///< false: whoever finds it, or does not, is neither right nor wrong
  bool isolated = true;
};

/// Grades the vortices of one field, in their order: of the opposite pairs the closest is removed,
/// again and again, until none is closer than kClosestRequiredPair. What is left is required. Give
/// the vortices beyond the array too, or pairs across its edge are torn apart.
std::vector<GradedVortex> grade_vortices(std::span<const SceneVortex> vortices);

}  // namespace curlew
