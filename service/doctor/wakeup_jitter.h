// The machine's own jitter: how late a thread is woken up that does nothing but sleep. A program of
// the same priority is at least as late.
#pragma once

#include <string>
#include <vector>

#include "core/latency_histogram.h"

namespace curlew {

struct WakeupJitter {
  LatencyHistogram late_ns;  ///< one entry for each wake-up; none if the priority was refused
  std::vector<std::string> refused;  ///< one sentence for each CPU or priority that was refused
};

/// Sleeps until each full millisecond (CLOCK_MONOTONIC, absolute) for this long, on a thread of its
/// own with these CPUs (none: any) and this SCHED_FIFO priority (0: ordinary). Ends early when
/// interrupted. The kernel adds up to 50 µs of timer slack to the sleep of ordinary threads, and
/// none to SCHED_FIFO.
WakeupJitter measure_wakeup_jitter(double seconds, const std::vector<int>& cpus, int priority);

}  // namespace curlew
