// Several things are timed in turn, round after round, so that whatever else the machine does falls
// on all of them alike.
#pragma once

#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <vector>

namespace curlew {

struct TimedRun {
  std::function<void()> prepare;  ///< goes before every run and is not timed; may be empty
  std::function<void()> run;
};

/// Says how long a run takes, in µs. These are quantiles over the rounds.
struct RoundTimes {
  double median_us = 0.0;
  double p10_us = 0.0;
  double p90_us = 0.0;
};

/// Times each of the runs in each of `rounds` rounds, of which there must be one at least. Some
/// rounds go before them to warm up and do not count. Throws Failure if the user asks to stop.
std::vector<RoundTimes> time_in_turn(const std::vector<TimedRun>& runs, int rounds);

/// Returns {"median_us": …, "p10_us": …, "p90_us": …}.
nlohmann::ordered_json times_json(const RoundTimes& times);

}  // namespace curlew
