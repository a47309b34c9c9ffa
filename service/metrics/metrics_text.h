// This writes the daemon's figures as Prometheus reads them (text format 0.0.4).
#pragma once

#include <string>

#include "service/daemon/daemon_status.h"
#include "service/metrics/live_metrics.h"

namespace curlew {

/// Returns all metrics, each with its help and type; the last line ends in a line feed.
/// docs/metrics.md lists them. Times are in seconds.
std::string metrics_text(const LiveMetrics& live, const StatusSnapshot& status);

}  // namespace curlew
