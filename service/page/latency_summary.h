// This file declares how the latencies of frames are summed up for the page.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <span>

#include "service/stages.h"

namespace curlew {

/// Returns the names of the stages, then "publish" and "total"; for each p50, p90, p99 and max in
/// µs, which are exact order statistics; and a histogram of the total with edges_us, ten to a
/// decade, and counts, of which each counts the latencies from its edge to the next.
nlohmann::ordered_json latency_summary(std::span<const FrameLatency> latencies);

}  // namespace curlew
