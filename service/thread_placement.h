// ThreadPlacement gives CPUs and a priority to the pipeline's threads, and keeps what was refused.
#pragma once

#include <cstddef>
#include <mutex>
#include <string>
#include <vector>

#include "service/pipeline.h"

namespace curlew {

class ThreadPlacement {
 public:
  /// cpus: given to the threads in turn; empty: any. priority: of SCHED_FIFO; 0: ordinary.
  ThreadPlacement(std::vector<int> cpus, int priority);

  /// Returns what the pipeline calls in each thread. This object must outlive the pipeline.
  PipelineThreadStart thread_start();

  /// Returns one sentence for each thing that was refused.
  std::vector<std::string> refused() const;

  /// Returns "none", "cpu 0 1", or that the system refused.
  std::string description() const;

 private:
  std::vector<int> cpus_;
  int priority_;
  mutable std::mutex mutex_;  // threads start, and are asked about, at different times
  std::vector<std::string> refused_;
};

}  // namespace curlew
