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

/// A place a detector names, in lenslet units. A larger score is surer; scores are compared over
/// all frames of a detector, never between detectors.
struct Candidate {
  double x = 0.0;
  double y = 0.0;
  int charge = 0;  ///< +1 or −1
  double score = 0.0;
};

/// A candidate for each vortex that has a charge, scored by its probability. Unresolved pairs are
/// no candidates.
std::vector<Candidate> candidates_by_probability(const VortexList& vortices);

/// The false alarms a frame at which recall is stated.
inline constexpr double kStatedFalseAlarms = 0.05;

/// Where vortices and candidates count: the square of the array's nodes, [½, n − 1½] in lenslet
/// units along an axis of n lenslets, which is [1, n − 1] from the array's edge. With a pupil: the
/// lenslets of that square that have all eight round them in the pupil, so that every node at their
/// corners has its four lenslets. In a square pupil that is the same.
struct Interior {
  int rows = 0;  ///< lenslets
  int cols = 0;
  const Image<std::uint8_t>* pupil = nullptr;  ///< [rows, cols], 0 outside; null: all is inside

  bool contains(double x, double y) const {
    if (!(x >= 0.5 && x <= cols - 1.5 && y >= 0.5 && y <= rows - 1.5)) return false;
    if (pupil == nullptr) return true;
    const int row =
        std::min(static_cast<int>(std::lround(y)), rows - 2);  // on the far side: the last
    const int col = std::min(static_cast<int>(std::lround(x)), cols - 2);
    bool inside = true;
    for (int r = row - 1; r <= row + 1; ++r)
      for (int c = col - 1; c <= col + 1; ++c) inside = inside && (*pupil)(r, c) != 0;
    return inside;
  }
};

/// A candidate that counts.
struct Verdict {
  double score = 0.0;
  bool hit = false;       ///< else it is a false alarm
  bool isolated = false;  ///< hits: of an isolated vortex
  double error = 0.0;     ///< hits: distance from the vortex, pitches
  int vortex = -1;        ///< hits: which, an index into the truth
};

struct FrameVerdicts {
  int required = 0;               ///< required vortices in the interior
  std::vector<Verdict> verdicts;  ///< by falling score; candidates that do not count are left out
};

/// Matches one to one. The candidates choose by falling score, each the nearest required vortex of
/// its sign in the interior, within kHitRadius (truth_match.h), that is not taken: so what lies
/// below a threshold never changes what lies above. One that gets none does not count where it lies
/// within kHitRadius of another vortex of its sign that is not required or not in the interior, or
/// where it lies outside the interior itself. Else it is a false alarm.
FrameVerdicts judge_frame(std::vector<Candidate> candidates, std::span<const GradedVortex> truth,
                          const Interior& interior);

/// NaN where a figure is not defined: nothing required, or nothing hit.
struct DetectionScore {
  double f1 = 0.0;       ///< at the threshold given
  double best_f1 = 0.0;  ///< at the threshold best for these very frames: optimistic
  /// Σ (step of recall)·precision over the thresholds, without interpolation.
  double average_precision = 0.0;
  double recall = 0.0;        ///< at kStatedFalseAlarms a frame at most
  double rms = 0.0;           ///< of the distances of hits at the threshold given, pitches
  double isolated_rms = 0.0;  ///< the same of isolated vortices
};

struct ScoreMember {
  std::string_view name;  ///< as in JSON
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

/// All verdicts of one detector over some frames, in one order. Equal scores stand or fall
/// together.
class DetectionRecord {
 public:
  explicit DetectionRecord(std::span<const FrameVerdicts> frames);

  int required() const { return total_required_; }

  /// The score from which on candidates are believed so that F1 is best; +infinity where no
  /// threshold finds anything.
  double best_threshold() const;

  DetectionScore score(double threshold) const;

  /// As score(), of `samples` draws of as many frames with replacement. The same seed draws the
  /// same frames, so that two detectors' samples can be compared one by one.
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
