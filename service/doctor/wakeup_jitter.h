// The machine's own jitter: how late a thread that only sleeps is woken up. What a program of the
// same priority is late by is at least this.
#pragma once

#include <string>
#include <vector>

#include "core/latency_histogram.h"

namespace curlew {

struct WakeupJitter {
  LatencyHistogram late_ns;          ///< one entry a wake-up; none where the priority was refused
  std::vector<std::string> refused;  ///< priority or CPU that was not given, one sentence each
};

/// Sleeps to the millisecond (CLOCK_MONOTONIC, absolute) for so long, on a thread of its own with
/// these CPUs (none: any) and SCHED_FIFO priority (0: ordinary). Ends early when interrupted.
/// The kernel adds up to 50 µs of timer slack to ordinary threads' sleeps, none to SCHED_FIFO's.
WakeupJitter measure_wakeup_jitter(double seconds, const std::vector<int>& cpus, int priority);

}  // namespace curlew
