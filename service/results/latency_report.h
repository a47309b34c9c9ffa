// The latency table, for people and as JSON.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "service/pipeline.h"

namespace curlew {

/// p50, p90, p99, p99.9 and max of every stage, of publishing and in total, in µs.
std::string latency_table(const RunReport& report);
nlohmann::ordered_json latency_json(const RunReport& report);

/// What the figures were measured with: build, compiler, CPU model, CPUs that may be used.
nlohmann::ordered_json machine_json();

}  // namespace curlew
