#include "service/realtime/realtime.h"

#include <fcntl.h>
#include <pthread.h>
#include <sched.h>
#include <spdlog/fmt/fmt.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <optional>
#include <sstream>

#include "service/realtime/cpu_list.h"

#ifndef MADV_COLLAPSE
#define MADV_COLLAPSE 25  // since Linux 6.1; glibc 2.36 does not name it yet
#endif

namespace curlew {
namespace {

constexpr std::uintptr_t kHugePageBytes = std::uintptr_t{2} << 20;
constexpr const char* kProcessStatus = "/proc/self/status";
constexpr const char* kMemory = "/proc/self/smaps_rollup";
constexpr int kCapIpcLock = 14;
constexpr int kCapSysNice = 23;

std::string reason(int error) { return std::strerror(error); }  // NOLINT(concurrency-mt-unsafe)

/// Returns the number behind "name:" in a file of /proc, or nothing if there is no such line.
std::optional<std::uint64_t> field_of(const char* file, const std::string& name, int base = 10) {
  std::ifstream lines(file);
  for (std::string line; std::getline(lines, line);)
    if (line.rfind(name + ":", 0) == 0)
      return std::strtoull(line.c_str() + name.size() + 1, nullptr, base);
  return std::nullopt;
}

bool has_capability(int capability) {
  const auto effective = field_of(kProcessStatus, "CapEff", 16);
  return effective && ((*effective >> capability) & 1U) != 0;
}

/// Raises the soft limit to the hard limit, which needs no rights, and returns it.
rlim_t raised_limit(__rlimit_resource resource) {
  rlimit limit{};
  if (getrlimit(resource, &limit) != 0) return 0;
  if (limit.rlim_cur != limit.rlim_max) {
    limit.rlim_cur = limit.rlim_max;
    setrlimit(resource, &limit);
    getrlimit(resource, &limit);
  }
  return limit.rlim_cur;
}

std::vector<int> cpus_of_thread() {
  cpu_set_t set;
  CPU_ZERO(&set);
  std::vector<int> cpus;
  if (pthread_getaffinity_np(pthread_self(), sizeof set, &set) != 0) return cpus;
  for (std::size_t cpu = 0; cpu < CPU_SETSIZE; ++cpu)
    if (CPU_ISSET(cpu, &set)) cpus.push_back(static_cast<int>(cpu));
  return cpus;
}

/// Binds the thread to exactly these CPUs. Returns a sentence if that was refused.
std::optional<std::string> pin(const std::string& name, const std::vector<int>& cpus) {
  const std::string before = cpu_text(cpus_of_thread());
  const std::string wanted = cpu_text(cpus);
  cpu_set_t set;
  CPU_ZERO(&set);
  bool exist = true;
  for (const int cpu : cpus) {
    exist = exist && cpu >= 0 && cpu < CPU_SETSIZE;
    if (exist) CPU_SET(static_cast<std::size_t>(cpu), &set);
  }
  if (exist) pthread_setaffinity_np(pthread_self(), sizeof set, &set);
  const std::string got = cpu_text(cpus_of_thread());
  if (exist && got == wanted) return std::nullopt;
  return fmt::format(
      "thread {} is not bound to CPU {} but may run on {}: choose from CPUs {}, or widen the set "
      "the process may use (taskset, CPUAffinity= or AllowedCPUs= of its unit)",
      name, wanted, got, before);
}

/// Returns a note on the time that real-time threads may use of each period, which is usually a
/// second. A time of 0 refuses them all.
std::string throttling() {
  std::ifstream file("/proc/sys/kernel/sched_rt_runtime_us");
  std::int64_t runtime_us = 0;
  if (!(file >> runtime_us)) return "";
  return fmt::format("; kernel.sched_rt_runtime_us is {}", runtime_us);
}

/// Gives the thread this SCHED_FIFO priority. Returns a sentence if that was refused.
std::optional<std::string> prioritize(const std::string& name, int priority) {
  const rlim_t limit = raised_limit(RLIMIT_RTPRIO);
  sched_param wanted{};
  wanted.sched_priority = priority;
  const int error = pthread_setschedparam(pthread_self(), SCHED_FIFO, &wanted);
  int policy = SCHED_OTHER;
  sched_param got{};
  pthread_getschedparam(pthread_self(), &policy, &got);
  if (policy == SCHED_FIFO && got.sched_priority == priority) return std::nullopt;
  const std::string remedy =
      has_capability(kCapSysNice)
          ? std::string("allow its control group real-time run time (cpu.rt_runtime_us)")
          : fmt::format(
                "set LimitRTPRIO={0} in its unit, or 'USER - rtprio {0}' in "
                "/etc/security/limits.d, or give it CAP_SYS_NICE",
                priority);
  return fmt::format(
      "thread {} keeps ordinary priority, SCHED_FIFO {} was refused ({}; RLIMIT_RTPRIO is {}): "
      "{}{}",
      name, priority, reason(error), limit, remedy, throttling());
}

struct Range {
  std::uintptr_t begin;
  std::uintptr_t end;
  std::uintptr_t bytes() const { return end - begin; }
};

/// Returns the process's writable anonymous memory, cut down to whole huge pages.
std::vector<Range> big_ranges() {
  // A range larger than the machine's memory is only reserved, as the shadow of a sanitizer is.
  const auto memory_bytes = static_cast<std::uintptr_t>(sysconf(_SC_PHYS_PAGES)) *
                            static_cast<std::uintptr_t>(sysconf(_SC_PAGESIZE));
  std::vector<Range> ranges;
  std::ifstream maps("/proc/self/maps");
  for (std::string line; std::getline(maps, line);) {
    std::istringstream fields(line);
    Range range{};
    char dash = 0;
    std::string mode, offset, device, name;
    std::uint64_t inode = 0;
    fields >> std::hex >> range.begin >> dash >> range.end >> mode >> offset >> device >>
        std::dec >> inode >> name;
    if (!fields && !fields.eof()) continue;
    if (mode != "rw-p" || inode != 0 || (!name.empty() && name != "[heap]")) continue;
    if (range.bytes() > memory_bytes) continue;
    range.begin = (range.begin + kHugePageBytes - 1) & ~(kHugePageBytes - 1);
    range.end &= ~(kHugePageBytes - 1);
    if (range.begin < range.end) ranges.push_back(range);
  }
  return ranges;
}

/// Makes a pointer of an address that the kernel gave as a number in a file.
void* address(std::uintptr_t number) {
  return reinterpret_cast<void*>(number);  // NOLINT(performance-no-int-to-ptr)
}

std::uint64_t megabytes(std::uint64_t kilobytes) { return (kilobytes + 512) / 1024; }

}  // namespace

int usable_cpus() noexcept {
  cpu_set_t cpus;
  return sched_getaffinity(0, sizeof cpus, &cpus) == 0 ? CPU_COUNT(&cpus) : 1;
}

std::vector<std::string> enter_realtime(const std::string& name, const std::vector<int>& cpus,
                                        int priority) {
  constexpr std::size_t kNameLength = 15;
  pthread_setname_np(pthread_self(), name.substr(0, kNameLength).c_str());
  std::vector<std::string> refused;
  if (!cpus.empty())
    if (auto sentence = pin(name, cpus)) refused.push_back(*std::move(sentence));
  if (priority > 0)
    if (auto sentence = prioritize(name, priority)) refused.push_back(*std::move(sentence));
  return refused;
}

ProcessRealtime::ProcessRealtime(const RealtimeOptions& options) {
  if (options.huge_pages) use_huge_pages();  // first, because locked pages stay as they are
  if (options.lock_memory) lock_memory();
  if (options.max_cpu_wakeup_us >= 0) hold_c_states(options.max_cpu_wakeup_us);
}

ProcessRealtime::~ProcessRealtime() {
  if (locked_) munlockall();
  if (latency_device_ >= 0) close(latency_device_);
}

void ProcessRealtime::use_huge_pages() {
  const std::vector<Range> ranges = big_ranges();
  // Where memory is fragmented the kernel takes long. After two seconds the rest is left to the
  // kernel's own khugepaged, which does it later.
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(2);
  for (const Range& range : ranges) {
    madvise(address(range.begin), range.bytes(), MADV_HUGEPAGE);
    for (auto page = range.begin; page < range.end; page += kHugePageBytes)
      if (std::chrono::steady_clock::now() < end)
        madvise(address(page), kHugePageBytes, MADV_COLLAPSE);  // refused before Linux 6.1
  }
  const std::uint64_t huge_kb = field_of(kMemory, "AnonHugePages").value_or(0);
  if (huge_kb > 0)
    got_.push_back(fmt::format("huge pages ({} MB)", megabytes(huge_kb)));
  else if (ranges.empty())
    refused_.emplace_back("no huge pages: no buffer is as large as one (2 MB); nothing to change");
  else
    refused_.emplace_back(
        "no huge pages: the kernel gave none; run 'echo madvise | sudo tee "
        "/sys/kernel/mm/transparent_hugepage/enabled'");
}

void ProcessRealtime::lock_memory() {
  const rlim_t limit = raised_limit(RLIMIT_MEMLOCK);
  const bool unlimited = limit == RLIM_INFINITY || has_capability(kCapIpcLock);
  const std::uint64_t size_kb = field_of(kProcessStatus, "VmSize").value_or(0);
  const std::string limit_text =
      limit == RLIM_INFINITY ? std::string("unlimited") : fmt::format("{} MB", limit >> 20);
  // Under a limit MCL_FUTURE would make later allocations fail, and a locked stack could not grow.
  // So under a limit only the present memory is locked, and only if it fits with room to spare.
  constexpr std::uint64_t kSpareKb = 64 << 10;
  int error = 0;
  if (!unlimited && limit >> 10 < size_kb + kSpareKb)
    error = ENOMEM;
  else if (mlockall(unlimited ? MCL_CURRENT | MCL_FUTURE : MCL_CURRENT) != 0)
    error = errno;
  locked_ = error == 0;
  if (!locked_) {
    refused_.push_back(fmt::format(
        "memory is not locked ({}; the program takes {} MB and RLIMIT_MEMLOCK is {}): set "
        "LimitMEMLOCK=infinity in its unit, or 'USER - memlock unlimited' in "
        "/etc/security/limits.d, or give it CAP_IPC_LOCK",
        reason(error), megabytes(size_kb), limit_text));
    return;
  }
  if (field_of(kProcessStatus, "VmLck").value_or(0) == 0) {
    refused_.emplace_back(
        "memory is not locked although mlockall succeeded: VmLck is 0, as under a sanitizer");
    return;
  }
  std::string sentence =
      fmt::format("memory locked ({} MB)", megabytes(field_of(kMemory, "Locked").value_or(0)));
  if (!unlimited)
    sentence.append(", what is allocated later is not: RLIMIT_MEMLOCK is ").append(limit_text);
  got_.push_back(std::move(sentence));
}

void ProcessRealtime::hold_c_states(int max_wakeup_us) {
  constexpr const char* kDevice = "/dev/cpu_dma_latency";
  // The kernel takes a 32-bit number of µs, which holds until the file is closed. Reading gives the
  // least value that any process holds.
  const std::int32_t wanted_us = max_wakeup_us;
  std::int32_t got_us = -1;
  int error = 0;
  latency_device_ = open(kDevice, O_RDWR | O_CLOEXEC);
  if (latency_device_ < 0 || write(latency_device_, &wanted_us, sizeof wanted_us) < 0 ||
      pread(latency_device_, &got_us, sizeof got_us, 0) < 0)
    error = errno;
  if (error == 0 && got_us >= 0 && got_us <= wanted_us) {
    got_.push_back(fmt::format("CPUs wake up within {} µs", got_us));
    return;
  }
  if (latency_device_ >= 0) close(latency_device_);
  latency_device_ = -1;
  if (error == ENOENT)
    refused_.push_back(fmt::format(
        "C-states are not held: there is no {}; its kernel lacks CONFIG_CPU_IDLE", kDevice));
  else
    refused_.push_back(
        fmt::format("C-states are not held ({}: {}): run as root or in the group that may write "
                    "it, or 'sudo setfacl -m u:$USER:rw {}'",
                    kDevice, error != 0 ? reason(error) : "another value was read back", kDevice));
}

}  // namespace curlew
