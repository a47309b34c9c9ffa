// Detection scores: what a detector's candidates are worth against the true vortices.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "core/image.h"
#include "core/vortex.h"
#include "service/bench/bootstrap.h"
#include "service/results/truth_match.h"

namespace curlew {

/// A place that a detector names, in lenslet units. A larger score means more certainty. Scores are
/// compared over all frames of one detector, never between detectors.
struct Candidate {
  double x = 0.0;
  double y = 0.0;
  int charge = 0;  ///< +1 or −1
  double score = 0.0;
};

/// A candidate for each vortex that has a charge, scored by its probability. Unresolved pairs are
/// no candidates.
std::vector<Candidate> candidates_by_probability(const VortexList& vortices);

/// Recall is stated at this rate of false alarms a frame.
inline constexpr double kStatedFalseAlarms = 0.05;

/// The region in which vortices and candidates count: the square of the array's nodes, [½, n − 1½]
/// in lenslet units along an axis of n lenslets, which is [1, n − 1] from the array's edge. With a
/// pupil, only those lenslets of the square count whose eight neighbours lie in the pupil, so that
/// every node at their corners has its four lenslets. A square pupil changes nothing.
struct Interior {
  int rows = 0;  ///< lenslets
  int cols = 0;
  /// [rows, cols], 0 outside the pupil; null: all lenslets are in it.
  const Image<std::uint8_t>* pupil = nullptr;

  bool contains(double x, double y) const {
    if (!(x >= 0.5 && x <= cols - 1.5 && y >= 0.5 && y <= rows - 1.5)) return false;
    if (pupil == nullptr) return true;
    // The far side belongs to the last lenslet.
    const int row = std::min(static_cast<int>(std::lround(y)), rows - 2);
    const int col = std::min(static_cast<int>(std::lround(x)), cols - 2);
    bool inside = true;
    for (int r = row - 1; r <= row + 1; ++r)
      for (int c = col - 1; c <= col + 1; ++c) inside = inside && (*pupil)(r, c) != 0;
    return inside;
  }
};

/// The judgement of a candidate that counts.
struct Verdict {
  double score = 0.0;
  bool hit = false;       ///< true: it hits a vortex; false: it is a false alarm
  bool isolated = false;  ///< of a hit: its vortex is isolated
  double error = 0.0;     ///< of a hit: distance from its vortex, pitches
  int vortex = -1;        ///< of a hit: its vortex, as an index into the truth
};

struct FrameVerdicts {
  int required = 0;               ///< required vortices in the interior
  std::vector<Verdict> verdicts;  ///< by falling score; candidates that do not count are left out
};

/// Matches candidates and vortices one to one. The candidates choose by falling score. Each takes
/// the nearest required vortex of its sign in the interior that is within kHitRadius
/// (truth_match.h) and not yet taken. So candidates below a threshold never change the verdict on
/// those above. A candidate that gets none does not count if it lies outside the interior, or
/// within kHitRadius of another vortex of its sign that is not required or not in the interior.
/// Otherwise it is a false alarm.
FrameVerdicts judge_frame(std::vector<Candidate> candidates, std::span<const GradedVortex> truth,
                          const Interior& interior);

/// A figure is NaN where it is not defined, because nothing is required or nothing was hit.
struct DetectionScore {
  double f1 = 0.0;  ///< at the given threshold
  /// At the threshold that is best for these very frames, so it is optimistic.
  double best_f1 = 0.0;
  /// The sum Σ (step of recall)·precision over the thresholds, without interpolation.
  double average_precision = 0.0;
  double recall = 0.0;        ///< at kStatedFalseAlarms a frame or fewer
  double rms = 0.0;           ///< distance of hits at the given threshold, rms, pitches
  double isolated_rms = 0.0;  ///< rms for isolated vortices only
};

struct ScoreMember {
  std::string_view name;  ///< the key in JSON
  double DetectionScore::*value;
};
inline constexpr std::array<ScoreMember, 6> kScoreMembers = {{
    {"f1", &DetectionScore::f1},
    {"best_f1", &DetectionScore::best_f1},
    {"average_precision", &DetectionScore::average_precision},
    {"recall", &DetectionScore::recall},
    {"rms", &DetectionScore::rms},
    {"isolated_rms", &DetectionScore::isolated_rms},
}};

/// All verdicts of one detector over some frames, in one order. Candidates of equal score are
/// believed or rejected together.
class DetectionRecord {
 public:
  explicit DetectionRecord(std::span<const FrameVerdicts> frames);

  int required() const { return total_required_; }

  /// Returns the lowest score to believe for which F1 is best, or +infinity if no threshold finds
  /// anything.
  double best_threshold() const;

  DetectionScore score(double threshold) const;
  /// Returns the false alarms a frame of this score or more.
  double false_alarms(double threshold) const;

  /// Returns score() for `samples` draws of as many frames with replacement. The same seed draws
  /// the same frames, so that the samples of two detectors can be compared one by one.
  std::vector<DetectionScore> bootstrap(double threshold, int samples, std::uint64_t seed) const;

 private:
  struct Entry {
    Verdict verdict;
    std::size_t frame;
  };
  DetectionScore score(double threshold, std::span<const int> times) const;

  std::vector<int> required_;   // [frames]
  std::vector<Entry> entries_;  // by falling score
  int total_required_ = 0;
};

/// See bootstrap.h.
Interval interval_of(std::span<const DetectionScore> samples, double DetectionScore::*value,
                     double coverage = 0.95);

}  // namespace curlew
