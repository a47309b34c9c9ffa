// Several things are timed in turn, round after round, so that whatever else the machine does falls
// on all of them alike.
#pragma once

#include <cstddef>
#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <vector>

namespace curlew {

struct TimedRun {
  std::function<void()> prepare;  ///< goes before every run and is not timed; may be empty
  std::function<void()> run;
};

/// The rounds of a run are cut into so many parts, one after the other. Their medians tell how much
/// a figure moves while nothing is changed.
inline constexpr std::size_t kTimedParts = 10;

/// Says how long a run takes, in µs. These are quantiles over the rounds.
struct RoundTimes {
  double median_us = 0.0;
  double p10_us = 0.0;
  double p90_us = 0.0;
  std::vector<double>
      part_median_us;  ///< of kTimedParts parts, or of each round if there are fewer
};

/// Returns the quantiles of times that follow one another. There must be one at least.
RoundTimes summarise(const std::vector<double>& us);

/// Times each of the runs in each of `rounds` rounds, of which there must be one at least. Some
/// rounds go before them to warm up and do not count. Throws Failure if the user asks to stop.
std::vector<RoundTimes> time_in_turn(const std::vector<TimedRun>& runs, int rounds);

/// Returns {"median_us": …, "p10_us": …, "p90_us": …, "parts_us": […]}.
nlohmann::ordered_json times_json(const RoundTimes& times);

}  // namespace curlew
