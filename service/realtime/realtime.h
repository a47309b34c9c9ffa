// Real time: what the operating system can give a thread and a process. Every request is verified
// after it was made, and what was really got is reported.
#pragma once

#include <string>
#include <vector>

namespace curlew {

/// Section [realtime] of the configuration. Nothing is asked for by default.
struct RealtimeOptions {
  int priority = 0;              ///< SCHED_FIFO priority of the pipeline's threads; 0: ordinary
  int camera_priority = 0;       ///< of the thread that receives frames; 0: ordinary
  std::vector<int> camera_cpus;  ///< CPUs of the thread that receives frames; empty: any
  bool lock_memory = false;      ///< no page of the process is ever swapped or faulted in late
  bool huge_pages = false;       ///< frames and plans in 2 MB pages where the kernel has them
  int max_cpu_wakeup_us = -1;  ///< longest wake-up from a C-state, /dev/cpu_dma_latency; −1: any
};

/// Gives the calling thread CPUs (none: any) and a SCHED_FIFO priority (0: none), and a name of at
/// most 15 characters. Returns one sentence for each thing that was refused, with its remedy.
/// Never throws: a refusal is news, not an error.
std::vector<std::string> enter_realtime(const std::string& name, const std::vector<int>& cpus,
                                        int priority);

/// What holds for the whole process, as long as this object lives: huge pages, memory lock,
/// C-state hold. Make it when buffers and plans exist.
class ProcessRealtime {
 public:
  explicit ProcessRealtime(const RealtimeOptions& options);
  ~ProcessRealtime();
  ProcessRealtime(const ProcessRealtime&) = delete;
  ProcessRealtime& operator=(const ProcessRealtime&) = delete;

  /// What was got, in words, each verified: "memory locked (123 MB)".
  const std::vector<std::string>& got() const { return got_; }
  /// What was refused, one sentence each, with the remedy.
  const std::vector<std::string>& refused() const { return refused_; }

 private:
  void use_huge_pages();
  void lock_memory();
  void hold_c_states(int max_wakeup_us);

  bool locked_ = false;
  int latency_device_ = -1;  ///< open as long as the hold lasts
  std::vector<std::string> got_;
  std::vector<std::string> refused_;
};

}  // namespace curlew
