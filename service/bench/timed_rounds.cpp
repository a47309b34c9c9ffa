#include "service/bench/timed_rounds.h"

#include <algorithm>
#include <cstddef>
#include <nlohmann/json.hpp>

#include "core/error.h"
#include "service/bench/bench_timing.h"
#include "service/program/interrupt.h"

namespace curlew {

RoundTimes summarise(const std::vector<double>& us) {
  RoundTimes times{median(us), quantile(us, 0.1), quantile(us, 0.9), {}};
  const std::size_t parts = std::min(kTimedParts, us.size());
  for (std::size_t part = 0; part < parts; ++part) {
    const auto at = [&](std::size_t i) {
      return us.begin() + static_cast<std::ptrdiff_t>(i * us.size() / parts);
    };
    times.part_median_us.push_back(median(std::vector<double>(at(part), at(part + 1))));
  }
  return times;
}

std::vector<RoundTimes> time_in_turn(const std::vector<TimedRun>& runs, int rounds) {
  const int warm_up = rounds / 10 + 1;
  std::vector<std::vector<double>> taken_us(runs.size());
  for (int round = -warm_up; round < rounds; ++round) {
    if (interrupted()) throw Failure("interrupted");
    for (std::size_t i = 0; i < runs.size(); ++i) {
      if (runs[i].prepare) runs[i].prepare();
      const double us = time_us([&] { runs[i].run(); });
      if (round >= 0) taken_us[i].push_back(us);
    }
  }
  std::vector<RoundTimes> times;
  times.reserve(runs.size());
  for (const std::vector<double>& us : taken_us) times.push_back(summarise(us));
  return times;
}

nlohmann::ordered_json times_json(const RoundTimes& times) {
  return {{"median_us", times.median_us},
          {"p10_us", times.p10_us},
          {"p90_us", times.p90_us},
          {"parts_us", times.part_median_us}};
}

}  // namespace curlew
