#include "service/results/run_report.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace curlew {

void RunReport::merge(const RunReport& other) {
  frames += other.frames;
  vortices += other.vortices;
  overflow += other.overflow;
  dropped += other.dropped;
  late += other.late;
  not_converged += other.not_converged;
  measured += other.measured;
  lenslets += other.lenslets;
  in_islands += other.in_islands;
  too_blurred += other.too_blurred;
  for (std::size_t i = 0; i < kFollowStates; ++i) followed[i] += other.followed[i];
  lost += other.lost;
  for (std::size_t i = 0; i < kLensletStates; ++i) unmeasured[i] += other.unmeasured[i];
  for (std::size_t i = 0; i < kStageCount; ++i) stage[i].merge(other.stage[i]);
  publish.merge(other.publish);
  total.merge(other.total);
  seconds += other.seconds;
}

std::string nothing_measured(const RunReport& report) {
  if (report.measured > 0 || report.frames == 0) return {};
  struct Reason {
    LensletState state;
    const char* text;
  };
  std::array<Reason, 5> reasons{{{LensletState::kFaint, "too faint"},
                                 {LensletState::kSaturated, "saturated"},
                                 {LensletState::kAtEdge, "at the edge of their windows"},
                                 {LensletState::kBadPixels, "on bad pixels"},
                                 {LensletState::kLost, "without a spot of their own"}}};
  const auto times = [&](const Reason& reason) {
    return report.unmeasured[static_cast<std::size_t>(reason.state)];
  };
  std::int64_t all = 0;
  for (const Reason& reason : reasons) all += times(reason);
  if (all == 0) return "nothing was measured: the sensor file has no lit lenslet";
  std::stable_sort(reasons.begin(), reasons.end(),
                   [&](const Reason& a, const Reason& b) { return times(a) > times(b); });
  std::string text;
  for (const Reason& reason : reasons) {
    const std::int64_t percent = (200 * times(reason) + all) / (2 * all);
    if (percent > 0)
      text += (text.empty() ? "" : ", ") + std::to_string(percent) + " % " + reason.text;
  }
  return "nothing was measured: of " + std::to_string(all) + " spots in " +
         std::to_string(report.frames) + " frames " + text;
}

std::string followed_text(const RunReport& report) {
  const auto frames = [&](FollowState state) {
    return report.followed[static_cast<std::size_t>(state)];
  };
  std::string text;
  const auto add = [&](FollowState state, const std::string& what) {
    if (frames(state) == 0) return;
    text += (text.empty() ? "" : ", ") + what + " in " + std::to_string(frames(state)) + " of " +
            std::to_string(report.frames) + " frames";
  };
  add(FollowState::kMoved, "windows moved after the spots");
  add(FollowState::kAcquired, "spots were found anew");
  add(FollowState::kLost, "spots were not found");
  add(FollowState::kNoLight, "there was no light");
  if (report.lost > 0) {
    const std::int64_t all = report.lost + report.measured;
    text += (text.empty() ? "" : "; ") + std::to_string((200 * report.lost + all) / (2 * all)) +
            " % of the lenslets had no spot of their own, as beyond the beam";
  }
  return text;
}

std::vector<std::string> doubts(const RunReport& report) {
  constexpr double kManyMissing = 0.05;
  std::vector<std::string> texts;
  if (report.measured == 0 || report.lenslets == 0) return texts;
  const double missing = static_cast<double>(report.lenslets - report.measured - report.lost) /
                         static_cast<double>(report.lenslets);
  if (missing > kManyMissing) {
    texts.push_back(std::to_string(std::lround(100.0 * missing)) +
                    " % of the lenslets in the beam had no slope, because they were faint or "
                    "saturated: what is found beside them is less sure");
  }
  if (report.too_blurred > 0) {
    texts.push_back("in " + std::to_string(report.too_blurred) + " of " +
                    std::to_string(report.frames) +
                    " frames the spots were wider than the classifier knows (a blur of over 0.9 "
                    "lambda/w): it looked for no vortex there; the method whitened would have");
  }
  if (report.in_islands > 0) {
    texts.push_back("in " + std::to_string(report.in_islands) + " of " +
                    std::to_string(report.frames) +
                    " frames missing lenslets cut the phase into islands, each with mean 0: "
                    "rms, modes or a mirror's command over all of it are wrong there (N_ISLANDS, "
                    "and ISLAND beside --save phase)");
  }
  return texts;
}

std::string found_text(const RunReport& report) {
  if (!nothing_measured(report).empty()) return "nothing measured";
  return std::to_string(report.vortices) + " vortices";
}

}  // namespace curlew
