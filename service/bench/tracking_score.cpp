#include "service/bench/tracking_score.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <tuple>
#include <utility>

#include "core/assignment.h"
#include "service/bench/tracking_dataset.h"
#include "service/results/truth_match.h"

namespace curlew {
namespace {

template <typename A, typename B>
double distance(const A& a, const B& b) {
  return std::hypot(a.x - b.x, a.y - b.y);
}

bool counts(const GradedVortex& vortex, const Interior& interior) {
  return vortex.required && interior.contains(vortex.x, vortex.y);
}

/// This index stands for no reported vortex.
constexpr std::size_t kNone = static_cast<std::size_t>(-1);

/// Returns for each true vortex the index of the reported vortex that hits it, or kNone.
std::vector<std::size_t> match(const std::vector<TrueVortex>& truth,
                               const std::vector<ReportedVortex>& reported,
                               const Interior& interior,
                               const std::map<int, std::int64_t>& last_track) {
  // The bool is false where this track hit the vortex last, so that such pairs sort first.
  std::vector<std::tuple<bool, double, std::size_t, std::size_t>> pairs;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    if (!counts(truth[i].vortex, interior)) continue;
    const auto last = last_track.find(truth[i].identity);
    for (std::size_t j = 0; j < reported.size(); ++j) {
      const double away = distance(truth[i].vortex, reported[j]);
      if (truth[i].vortex.charge != reported[j].charge || away > kHitRadius) continue;
      const bool same = last != last_track.end() && last->second == reported[j].track;
      pairs.emplace_back(!same, away, i, j);
    }
  }
  std::sort(pairs.begin(), pairs.end());
  std::vector<std::size_t> hit_by(truth.size(), kNone);
  std::vector<bool> taken(reported.size(), false);
  for (const auto& [other, away, i, j] : pairs) {
    if (hit_by[i] != kNone || taken[j]) continue;
    hit_by[i] = j;
    taken[j] = true;
  }
  return hit_by;
}

// So many tracks of each vortex are looked at, those that hit it most often.
constexpr std::size_t kTracksPerVortex = 12;

/// Pairs each vortex with at most one track and the other way round, so that most hits agree, and
/// counts these hits in the frames' consistent_hits.
void count_consistent_hits(const std::vector<std::vector<std::pair<int, std::int64_t>>>& hits,
                           std::vector<TrackingCounts>& frames) {
  std::map<std::pair<int, std::int64_t>, int> together;
  std::map<int, std::size_t> rows;
  std::map<std::int64_t, std::size_t> cols;
  for (const auto& frame : hits) {
    for (const auto& [identity, track] : frame) {
      if (track < 0) continue;
      ++together[{identity, track}];
      rows.emplace(identity, rows.size());
      cols.emplace(track, cols.size());
    }
  }
  Assignment assignment(rows.size(), cols.size(), kTracksPerVortex);
  assignment.clear(rows.size(), cols.size());
  for (const auto& [pair, n] : together)
    assignment.allow(rows[pair.first], cols[pair.second], static_cast<float>(n));
  assignment.solve();
  for (std::size_t f = 0; f < hits.size(); ++f) {
    for (const auto& [identity, track] : hits[f]) {
      if (track < 0) continue;
      if (assignment.col_of_row()[rows[identity]] == static_cast<std::int32_t>(cols[track]))
        frames[f].consistent_hits += 1.0;
    }
  }
}

/// Scores the frames of one sequence, one after the other.
class TrackScorer {
 public:
  TrackScorer(std::size_t frames, const Interior& interior)
      : interior_(interior), frames_(frames), hits_(frames) {}

  void score_frame(std::size_t f, const std::vector<TrueVortex>& truth,
                   const std::vector<ReportedVortex>& reported) {
    frames_[f].frames = 1.0;
    const std::vector<bool> hit = count_hits(f, truth, reported);
    for (std::size_t j = 0; j < reported.size(); ++j) {
      const bool excused = is_excused(reported[j], truth);
      const bool false_alarm =
          !hit[j] && interior_.contains(reported[j].x, reported[j].y) && !excused;
      frames_[f].false_alarms += false_alarm ? 1.0 : 0.0;
      follow_life(f, reported[j].track, hit[j] || excused, false_alarm);
    }
  }

  /// Counts what only the whole sequence tells. Call it after the last frame.
  std::vector<TrackingCounts> finish() {
    for (const auto& [track, life] : lives_) {
      if (life.ever_false && !life.ever_hit) frames_[life.first_false].false_tracks += 1.0;
    }
    count_consistent_hits(hits_, frames_);
    return std::move(frames_);
  }

 private:
  /// What became of one track so far.
  struct Life {
    std::size_t first_false = 0;  ///< the frame of the track's first false alarm
    bool ever_false = false;
    bool ever_hit = false;  ///< it has hit some vortex, required or not
  };

  /// Counts the required vortices and their hits. Returns which of those reported hit one.
  std::vector<bool> count_hits(std::size_t f, const std::vector<TrueVortex>& truth,
                               const std::vector<ReportedVortex>& reported) {
    const std::vector<std::size_t> hit_by = match(truth, reported, interior_, last_track_);
    std::vector<bool> hit(reported.size(), false);
    for (std::size_t i = 0; i < truth.size(); ++i) {
      if (!counts(truth[i].vortex, interior_)) continue;
      frames_[f].required += 1.0;
      if (hit_by[i] == kNone) continue;
      hit[hit_by[i]] = true;
      count_hit(f, truth[i], reported[hit_by[i]]);
    }
    return hit;
  }

  void count_hit(std::size_t f, const TrueVortex& vortex, const ReportedVortex& found) {
    TrackingCounts& frame = frames_[f];
    frame.hits += 1.0;
    const double away = distance(vortex.vortex, found);
    frame.error2 += away * away;
    const double off =
        std::hypot(found.velocity_x - vortex.velocity_x, found.velocity_y - vortex.velocity_y);
    if (std::isfinite(off)) {
      frame.velocity_hits += 1.0;
      frame.velocity_error2 += off * off;
    }
    hits_[f].emplace_back(vortex.identity, found.track);
    if (found.track < 0) return;
    const auto [last, first_time] = last_track_.emplace(vortex.identity, found.track);
    if (!first_time && last->second != found.track) frame.switches += 1.0;
    last->second = found.track;
  }

  /// Returns whether a true vortex that does not count explains the reported one.
  bool is_excused(const ReportedVortex& found, const std::vector<TrueVortex>& truth) const {
    return std::any_of(truth.begin(), truth.end(), [&](const TrueVortex& t) {
      return t.vortex.charge == found.charge && distance(t.vortex, found) <= kHitRadius &&
             !counts(t.vortex, interior_);
    });
  }

  void follow_life(std::size_t f, std::int64_t track, bool hit, bool false_alarm) {
    if (track < 0) return;
    Life& life = lives_[track];
    life.ever_hit |= hit;
    if (false_alarm && !life.ever_false) {
      life.ever_false = true;
      life.first_false = f;
    }
  }

  const Interior& interior_;
  std::vector<TrackingCounts> frames_;
  /// The identity and the track of every hit, frame by frame.
  std::vector<std::vector<std::pair<int, std::int64_t>>> hits_;
  std::map<int, std::int64_t> last_track_;  ///< which track hit each identity last
  std::map<std::int64_t, Life> lives_;      ///< by track
};

}  // namespace

double TrackingCounts::rms() const { return std::sqrt(error2 / hits); }

double TrackingCounts::velocity_rms() const { return std::sqrt(velocity_error2 / velocity_hits); }

TrackingCounts& TrackingCounts::operator+=(const TrackingCounts& other) {
  for (const auto member :
       {&TrackingCounts::frames, &TrackingCounts::required, &TrackingCounts::hits,
        &TrackingCounts::false_alarms, &TrackingCounts::switches, &TrackingCounts::false_tracks,
        &TrackingCounts::error2, &TrackingCounts::velocity_hits, &TrackingCounts::velocity_error2,
        &TrackingCounts::consistent_hits})
    this->*member += other.*member;
  return *this;
}

std::vector<TrackingCounts> score_tracks(std::span<const std::vector<TrueVortex>> truth,
                                         std::span<const std::vector<ReportedVortex>> reported,
                                         const Interior& interior) {
  TrackScorer scorer(truth.size(), interior);
  for (std::size_t f = 0; f < truth.size(); ++f) scorer.score_frame(f, truth[f], reported[f]);
  return scorer.finish();
}

std::vector<std::vector<TrueVortex>> true_vortices(std::span<const std::vector<SceneVortex>> steps,
                                                   int steps_per_frame) {
  const auto identities = identify_vortices(steps);
  const auto stride = static_cast<std::size_t>(steps_per_frame);
  std::vector<std::vector<TrueVortex>> frames;
  for (std::size_t step = 0; step < steps.size(); step += stride) {
    const std::vector<GradedVortex> graded = grade_vortices(steps[step]);
    std::vector<TrueVortex>& frame = frames.emplace_back();
    const auto find = [&](std::size_t at, int identity) -> const SceneVortex* {
      // A step before the first one wraps round to a huge number.
      if (at >= steps.size()) return nullptr;
      for (std::size_t k = 0; k < identities[at].size(); ++k)
        if (identities[at][k] == identity) return &steps[at][k];
      return nullptr;
    };
    for (std::size_t i = 0; i < graded.size(); ++i) {
      TrueVortex vortex{.vortex = graded[i], .identity = identities[step][i]};
      const SceneVortex* before = find(step - stride, vortex.identity);
      const SceneVortex* after = find(step + stride, vortex.identity);
      const double frames_between =
          (before != nullptr ? 1.0 : 0.0) + (after != nullptr ? 1.0 : 0.0);
      if (frames_between > 0.0) {
        const SceneVortex& a = before != nullptr ? *before : steps[step][i];
        const SceneVortex& b = after != nullptr ? *after : steps[step][i];
        vortex.velocity_x = (b.x - a.x) / frames_between;
        vortex.velocity_y = (b.y - a.y) / frames_between;
      }
      frame.push_back(vortex);
    }
  }
  return frames;
}

}  // namespace curlew
