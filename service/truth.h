// The truth of simulated recordings, and what was found held against it.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "acquisition/truth.h"
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

}  // namespace curlew
