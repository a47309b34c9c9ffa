#include "service/results/track_summary.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "service/frame_time.h"

namespace curlew {
namespace {

constexpr double kNotKnown = std::numeric_limits<double>::quiet_NaN();

struct Line {
  double slope = kNotKnown;
  double error = kNotKnown;
};

/// Fits a straight line to n values v at the times t, by their sums.
Line fit_line(double n, double t, double tt, double v, double vv, double vt) {
  const double spread = tt - t * t / n;
  if (n < 2.0 || !(spread > 0.0)) return {};
  const double slope = (vt - t * v / n) / spread;
  if (n < 3.0) return {slope, kNotKnown};
  const double residual = std::max(0.0, vv - v * v / n - slope * slope * spread);
  return {slope, std::sqrt(residual / (n - 2.0) / spread)};
}

}  // namespace

void TrackSummary::add(std::int64_t frame, const FrameHeader& header, const VortexList& vortices) {
  const double now = time_s(header);
  for (const Vortex& v : vortices) {
    if (v.track < 0 || (v.flags & kVortexPredicted) != 0) continue;
    clock_ = clock_ || has_clock(header);
    const auto [place, is_new] = sums_.try_emplace(v.track);
    Sums& s = place->second;
    if (is_new) {
      s.charge = v.charge;
      s.first_frame = frame;
      s.begin = now;
      s.x0 = static_cast<double>(v.x);
      s.y0 = static_cast<double>(v.y);
    }
    const double t = now - s.begin;
    const double x = static_cast<double>(v.x) - s.x0;
    const double y = static_cast<double>(v.y) - s.y0;
    s.last_frame = frame;
    s.last_t = t;
    s.n += 1.0;
    s.t += t, s.tt += t * t, s.p += static_cast<double>(v.probability);
    s.x += x, s.xx += x * x, s.xt += x * t;
    s.y += y, s.yy += y * y, s.yt += y * t;
  }
}

std::vector<TrackLife> TrackSummary::tracks() const {
  std::vector<TrackLife> lives;
  for (const auto& [track, s] : sums_) {
    const Line x = fit_line(s.n, s.t, s.tt, s.x, s.xx, s.xt);
    const Line y = fit_line(s.n, s.t, s.tt, s.y, s.yy, s.yt);
    lives.push_back({track, s.charge, s.first_frame, s.last_frame, static_cast<std::int64_t>(s.n),
                     s.last_t, s.x0 + s.x / s.n, s.y0 + s.y / s.n, x.slope, y.slope, x.error,
                     y.error, s.p / s.n});
  }
  return lives;
}

RowTable TrackSummary::table(const std::string& beside) const {
  RowTable table("TRACKS",
                 {{"TRACK", 'K', ""},
                  {"CHARGE", 'J', ""},
                  {"FIRST_FRAME", 'K', ""},
                  {"LAST_FRAME", 'K', ""},
                  {"SIGHTINGS", 'K', ""},
                  {"LIFE", 'D', "s"},
                  {"X", 'D', ""},
                  {"Y", 'D', ""},
                  {"VX", 'D', "s-1"},
                  {"VY", 'D', "s-1"},
                  {"ERR_VX", 'D', "s-1"},
                  {"ERR_VY", 'D', "s-1"},
                  {"PROBABILITY", 'D', ""}},
                 beside);
  for (const TrackLife& t : tracks())
    table.append(t.track, t.charge, t.first_frame, t.last_frame, t.sightings, t.life, t.x, t.y,
                 t.velocity_x, t.velocity_y, t.error_velocity_x, t.error_velocity_y, t.probability);
  return table;
}

std::string TrackSummary::text(std::size_t most) const {
  std::vector<TrackLife> lives = tracks();
  if (lives.empty()) return {};
  std::stable_sort(lives.begin(), lives.end(), [](const TrackLife& a, const TrackLife& b) {
    return a.sightings > b.sightings;
  });
  const char* unit = clock_ ? "s" : "frames";
  std::string text = fmt::format("{:>6} {:>6} {:>13} {:>5} {:>9} {:>8} {:>8} {:>17} {:>17}\n",
                                 "track", "charge", "frames", "seen", fmt::format("life {}", unit),
                                 "x", "y", fmt::format("vx /{}", clock_ ? "s" : "frame"),
                                 fmt::format("vy /{}", clock_ ? "s" : "frame"));
  for (std::size_t i = 0; i < std::min(most, lives.size()); ++i) {
    const TrackLife& t = lives[i];
    text += fmt::format("{:>6} {:>+6} {:>13} {:>5} {:>9.4g} {:>8.3f} {:>8.3f} {:>17} {:>17}\n",
                        t.track, t.charge, fmt::format("{}-{}", t.first_frame, t.last_frame),
                        t.sightings, t.life, t.x, t.y,
                        fmt::format("{:.4g} ± {:.2g}", t.velocity_x, t.error_velocity_x),
                        fmt::format("{:.4g} ± {:.2g}", t.velocity_y, t.error_velocity_y));
  }
  if (lives.size() > most)
    text += fmt::format("… and {} more tracks that were seen less often (table TRACKS in --out)\n",
                        lives.size() - most);
  return text;
}

}  // namespace curlew
