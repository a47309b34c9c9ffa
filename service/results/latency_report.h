// The table of latencies, for people and as JSON.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "service/pipeline.h"

namespace curlew {

/// These give p50, p90, p99, p99.9 and the maximum of every stage, of publishing and of the total,
/// in µs.
std::string latency_table(const RunReport& report);
nlohmann::ordered_json latency_json(const RunReport& report);

/// Returns what the figures were measured with: build, compiler, CPU model and usable CPUs.
nlohmann::ordered_json machine_json();

/// Returns the same for people, in two lines.
std::string machine_text();

}  // namespace curlew
