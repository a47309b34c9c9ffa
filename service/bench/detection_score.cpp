#include "service/bench/detection_score.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace curlew {
namespace {

constexpr double kNothing = std::numeric_limits<double>::quiet_NaN();

double ratio(double part, double whole) { return whole > 0.0 ? part / whole : kNothing; }

template <typename A, typename B>
double distance(const A& a, const B& b) {
  return std::hypot(a.x - b.x, a.y - b.y);
}

/// Returns F1 = 2·precision·recall/(precision + recall).
double f1(double hits, double false_alarms, double required) {
  return ratio(2.0 * hits, hits + false_alarms + required);
}

bool counts(const GradedVortex& vortex, const Interior& interior) {
  return vortex.required && interior.contains(vortex.x, vortex.y);
}

}  // namespace

std::vector<Candidate> candidates_by_probability(const VortexList& vortices) {
  std::vector<Candidate> candidates;
  for (const Vortex& vortex : vortices) {
    if (vortex.charge == 0) continue;
    candidates.push_back({static_cast<double>(vortex.x), static_cast<double>(vortex.y),
                          vortex.charge, static_cast<double>(vortex.probability)});
  }
  return candidates;
}

FrameVerdicts judge_frame(std::vector<Candidate> candidates, std::span<const GradedVortex> truth,
                          const Interior& interior) {
  FrameVerdicts frame;
  frame.required = static_cast<int>(std::count_if(
      truth.begin(), truth.end(), [&](const auto& vortex) { return counts(vortex, interior); }));
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const auto& a, const auto& b) { return a.score > b.score; });
  std::vector<bool> taken(truth.size(), false);
  for (const Candidate& candidate : candidates) {
    std::size_t chosen = truth.size();
    double nearest = std::numeric_limits<double>::infinity();
    bool excused = !interior.contains(candidate.x, candidate.y);
    for (std::size_t i = 0; i < truth.size(); ++i) {
      const double away = distance(candidate, truth[i]);
      if (truth[i].charge != candidate.charge || away > kHitRadius) continue;
      if (!counts(truth[i], interior)) {
        excused = true;
      } else if (!taken[i] && away < nearest) {
        nearest = away;
        chosen = i;
      }
    }
    if (chosen < truth.size()) {
      taken[chosen] = true;
      frame.verdicts.push_back(
          {candidate.score, true, truth[chosen].isolated, nearest, static_cast<int>(chosen)});
    } else if (!excused) {
      frame.verdicts.push_back({candidate.score, false, false, 0.0});
    }
  }
  return frame;
}

DetectionRecord::DetectionRecord(std::span<const FrameVerdicts> frames) {
  for (const FrameVerdicts& frame : frames) {
    for (const Verdict& verdict : frame.verdicts) entries_.push_back({verdict, required_.size()});
    required_.push_back(frame.required);
    total_required_ += frame.required;
  }
  std::stable_sort(entries_.begin(), entries_.end(),
                   [](const auto& a, const auto& b) { return a.verdict.score > b.verdict.score; });
}

double DetectionRecord::best_threshold() const {
  double best = 0.0;
  double threshold = std::numeric_limits<double>::infinity();
  double hits = 0.0;
  for (std::size_t i = 0; i < entries_.size(); ++i) {
    hits += entries_[i].verdict.hit ? 1.0 : 0.0;
    const double score = entries_[i].verdict.score;
    if (i + 1 < entries_.size() && entries_[i + 1].verdict.score == score) continue;
    const double here = f1(hits, static_cast<double>(i + 1) - hits, total_required_);
    if (here > best) {
      best = here;
      threshold = score;
    }
  }
  return threshold;
}

double DetectionRecord::false_alarms(double threshold) const {
  const auto n = std::count_if(entries_.begin(), entries_.end(), [&](const Entry& entry) {
    return !entry.verdict.hit && entry.verdict.score >= threshold;
  });
  return static_cast<double>(n) / static_cast<double>(required_.size());
}

DetectionScore DetectionRecord::score(double threshold) const {
  return score(threshold, std::vector<int>(required_.size(), 1));
}

/// times: how often each frame was drawn.
DetectionScore DetectionRecord::score(double threshold, std::span<const int> times) const {
  double required = 0.0;
  for (std::size_t i = 0; i < required_.size(); ++i) required += 1.0 * times[i] * required_[i];
  const double allowed = kStatedFalseAlarms * static_cast<double>(required_.size()) + 1e-9;

  double hits = 0.0, false_alarms = 0.0, ranked_hits = 0.0;
  double squares = 0.0, isolated_hits = 0.0, isolated_squares = 0.0;
  DetectionScore score;
  score.f1 = f1(0.0, 0.0, required);
  score.rms = score.isolated_rms = kNothing;
  for (std::size_t i = 0; i < entries_.size(); ++i) {
    const Verdict& verdict = entries_[i].verdict;
    const double weight = times[entries_[i].frame];
    if (verdict.hit) {
      hits += weight;
      if (verdict.score >= threshold) {
        const double square = weight * verdict.error * verdict.error;
        squares += square;
        isolated_squares += verdict.isolated ? square : 0.0;
        isolated_hits += verdict.isolated ? weight : 0.0;
      }
    } else {
      false_alarms += weight;
    }
    if (i + 1 < entries_.size() && entries_[i + 1].verdict.score == verdict.score) continue;
    const double here = f1(hits, false_alarms, required);
    score.best_f1 = std::max(score.best_f1, here);
    if (verdict.score >= threshold) {
      score.f1 = here;
      score.rms = std::sqrt(ratio(squares, hits));
      score.isolated_rms = std::sqrt(ratio(isolated_squares, isolated_hits));
    }
    if (false_alarms <= allowed) score.recall = hits / required;
    if (hits > ranked_hits)
      score.average_precision += (hits - ranked_hits) / required * hits / (hits + false_alarms);
    ranked_hits = hits;
  }
  if (required == 0.0) score.average_precision = score.recall = score.f1 = score.best_f1 = kNothing;
  return score;
}

std::vector<DetectionScore> DetectionRecord::bootstrap(double threshold, int samples,
                                                       std::uint64_t seed) const {
  std::vector<DetectionScore> scores;
  std::vector<int> times(required_.size());
  for (int sample = 0; sample < samples; ++sample) {
    std::fill(times.begin(), times.end(), 0);
    draw_frames(times.size(), seed, sample, [&](std::size_t frame) { ++times[frame]; });
    scores.push_back(score(threshold, times));
  }
  return scores;
}

Interval interval_of(std::span<const DetectionScore> samples, double DetectionScore::*value,
                     double coverage) {
  std::vector<double> values;
  for (const DetectionScore& sample : samples) values.push_back(sample.*value);
  return interval_of(std::move(values), coverage);
}

}  // namespace curlew
