#include "service/page/latency_summary.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <vector>

namespace curlew {
namespace {

constexpr double kUsPerNs = 1e-3;
constexpr int kEdgesPerDecade = 10;
constexpr int kDecades = 7;  // from 1 µs to 10 s

/// Returns the smallest that at least `fraction` of the sorted values do not exceed, in µs.
double percentile_us(const std::vector<std::int64_t>& sorted, double fraction) {
  const double wanted = std::ceil(fraction * static_cast<double>(sorted.size()));
  const auto rank = static_cast<std::size_t>(std::max(1.0, wanted));
  return kUsPerNs * static_cast<double>(sorted[rank - 1]);
}

nlohmann::ordered_json histogram_of(const std::vector<std::int64_t>& times_ns) {
  std::vector<double> edges_us;
  for (int i = 0; i <= kEdgesPerDecade * kDecades; ++i)
    edges_us.push_back(std::pow(10.0, static_cast<double>(i) / kEdgesPerDecade));
  std::vector<std::int64_t> counts(edges_us.size() - 1);
  for (const std::int64_t ns : times_ns) {
    const auto above = std::ranges::upper_bound(edges_us, kUsPerNs * static_cast<double>(ns));
    const auto bin = std::clamp<std::ptrdiff_t>(above - edges_us.begin() - 1, 0,
                                                static_cast<std::ptrdiff_t>(counts.size()) - 1);
    ++counts[static_cast<std::size_t>(bin)];
  }
  return {{"edges_us", edges_us}, {"counts", counts}};
}

}  // namespace

nlohmann::ordered_json latency_summary(std::span<const FrameLatency> latencies) {
  nlohmann::ordered_json summary{{"frames", latencies.size()}};
  if (latencies.empty()) return summary;
  auto& stages = summary["stages"] = nlohmann::ordered_json::array();
  const auto add = [&](const char* name, auto&& time_of) {
    std::vector<std::int64_t> times;
    times.reserve(latencies.size());
    for (const FrameLatency& latency : latencies) times.push_back(time_of(latency));
    std::ranges::sort(times);
    stages.push_back({{"name", name},
                      {"p50_us", percentile_us(times, 0.5)},
                      {"p90_us", percentile_us(times, 0.9)},
                      {"p99_us", percentile_us(times, 0.99)},
                      {"max_us", kUsPerNs * static_cast<double>(times.back())}});
    return times;
  };
  for (std::size_t i = 0; i < kStageCount; ++i)
    add(kStages[i].name, [i](const FrameLatency& latency) { return latency.stage_ns[i]; });
  add("publish", [](const FrameLatency& latency) { return latency.publish_ns; });
  summary["total"] =
      histogram_of(add("total", [](const FrameLatency& latency) { return latency.total_ns; }));
  return summary;
}

}  // namespace curlew
