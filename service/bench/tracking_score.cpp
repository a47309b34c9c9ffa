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

/// The index of whoever hits each true vortex, or none.
constexpr std::size_t kNone = static_cast<std::size_t>(-1);
std::vector<std::size_t> match(const std::vector<TrueVortex>& truth,
                               const std::vector<ReportedVortex>& reported,
                               const Interior& interior,
                               const std::map<int, std::int64_t>& last_track) {
  std::vector<std::tuple<bool, double, std::size_t, std::size_t>> pairs;  // false: hit it last
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

constexpr std::size_t kTracksPerVortex = 12;  // that are looked at

/// One to one, so that most hits agree; fills the frames' consistent_hits.
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
  std::vector<TrackingCounts> frames(truth.size());
  std::vector<std::vector<std::pair<int, std::int64_t>>> hits(truth.size());
  std::map<int, std::int64_t> last_track;  // by identity
  struct Life {
    std::size_t first_false = 0;  // the frame of its first false alarm
    bool ever_false = false;
    bool ever_hit = false;  // any vortex
  };
  std::map<std::int64_t, Life> lives;
  for (std::size_t f = 0; f < truth.size(); ++f) {
    TrackingCounts& frame = frames[f];
    frame.frames = 1.0;
    const auto hit_by = match(truth[f], reported[f], interior, last_track);
    std::vector<bool> hit(reported[f].size(), false);
    for (std::size_t i = 0; i < truth[f].size(); ++i) {
      const TrueVortex& vortex = truth[f][i];
      if (!counts(vortex.vortex, interior)) continue;
      frame.required += 1.0;
      if (hit_by[i] == kNone) continue;
      const ReportedVortex& found = reported[f][hit_by[i]];
      hit[hit_by[i]] = true;
      frame.hits += 1.0;
      const double away = distance(vortex.vortex, found);
      frame.error2 += away * away;
      const double off =
          std::hypot(found.velocity_x - vortex.velocity_x, found.velocity_y - vortex.velocity_y);
      if (std::isfinite(off)) {
        frame.velocity_hits += 1.0;
        frame.velocity_error2 += off * off;
      }
      hits[f].emplace_back(vortex.identity, found.track);
      if (found.track < 0) continue;
      const auto [last, first_time] = last_track.emplace(vortex.identity, found.track);
      if (!first_time && last->second != found.track) frame.switches += 1.0;
      last->second = found.track;
    }
    for (std::size_t j = 0; j < reported[f].size(); ++j) {
      const ReportedVortex& found = reported[f][j];
      const bool inside = interior.contains(found.x, found.y);
      const bool excused = std::any_of(truth[f].begin(), truth[f].end(), [&](const auto& t) {
        return t.vortex.charge == found.charge && distance(t.vortex, found) <= kHitRadius &&
               !counts(t.vortex, interior);
      });
      const bool false_alarm = !hit[j] && inside && !excused;
      frame.false_alarms += false_alarm ? 1.0 : 0.0;
      if (found.track < 0) continue;
      Life& life = lives[found.track];
      life.ever_hit |= hit[j] || excused;
      if (false_alarm && !life.ever_false) {
        life.ever_false = true;
        life.first_false = f;
      }
    }
  }
  for (const auto& [track, life] : lives) {
    if (life.ever_false && !life.ever_hit) frames[life.first_false].false_tracks += 1.0;
  }
  count_consistent_hits(hits, frames);
  return frames;
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
      if (at >= steps.size()) return nullptr;  // before the first one, too
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
