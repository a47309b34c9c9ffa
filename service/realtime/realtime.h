// Real time: what the operating system can give to a thread and to a process. Every request is
// verified after it was made, and what was really got is reported.
#pragma once

#include <string>
#include <vector>

namespace curlew {

/// Section [realtime] of the configuration. By default nothing is asked for.
struct RealtimeOptions {
  int priority = 0;         ///< SCHED_FIFO priority of the pipeline's threads; 0: ordinary
  int camera_priority = 0;  ///< SCHED_FIFO priority of the thread that receives frames; 0: ordinary
  std::vector<int> camera_cpus;  ///< CPUs of the thread that receives frames; empty: any
  /// whether all pages stay in memory, so that none is swapped or faulted in late
  bool lock_memory = false;
  /// Whether frames and plans lie in 2 MB pages where the kernel has them.
  bool huge_pages = false;
  /// Longest wake-up from a C-state in µs, by /dev/cpu_dma_latency; −1: any.
  int max_cpu_wakeup_us = -1;
};

/// Returns how many CPUs this process may use, which may be fewer than the machine has.
int usable_cpus() noexcept;

/// Gives the calling thread a name (cut to 15 characters), CPUs (if the list is empty, any) and a
/// SCHED_FIFO priority (0: ordinary). Returns one sentence for each thing that was refused, with
/// its remedy. Never throws, because a refusal is reported and is no error.
std::vector<std::string> enter_realtime(const std::string& name, const std::vector<int>& cpus,
                                        int priority);

/// Holds huge pages, the memory lock and the limit on C-states for the whole process, as long as
/// this object lives. Make it after the buffers and plans.
class ProcessRealtime {
 public:
  explicit ProcessRealtime(const RealtimeOptions& options);
  ~ProcessRealtime();
  ProcessRealtime(const ProcessRealtime&) = delete;
  ProcessRealtime& operator=(const ProcessRealtime&) = delete;

  /// What was got and verified, in words, such as "memory locked (123 MB)".
  const std::vector<std::string>& got() const { return got_; }
  /// What was refused, one sentence each, with its remedy.
  const std::vector<std::string>& refused() const { return refused_; }

 private:
  void use_huge_pages();
  void lock_memory();
  void hold_c_states(int max_wakeup_us);

  bool locked_ = false;
  int latency_device_ = -1;  ///< open as long as the limit on C-states holds
  std::vector<std::string> got_;
  std::vector<std::string> refused_;
};

}  // namespace curlew
