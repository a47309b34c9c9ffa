#include <linux/capability.h>
#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "service/doctor/machine_check_list.h"

namespace curlew {
namespace {

constexpr const char* kLimitsFile = "/etc/security/limits.d/90-curlew.conf";

std::string limit_command(const char* limit) {
  return fmt::format("echo \"$USER - {}\" | sudo tee -a {}  # then log in again", limit,
                     kLimitsFile);
}

}  // namespace

Check check_build(const Machine& machine, const MachineFiles&) {
  Check check;
  check.found = fmt::format("a {} build", machine.build_type);
  if (machine.build_type == "Release" || machine.build_type == "RelWithDebInfo") return check;
  check.verdict = CheckVerdict::kBad;
  check.advice = "only an optimised build keeps up";
  check.commands = {"./dev build"};
  return check;
}

Check check_rtprio(const Machine& machine, const MachineFiles& files) {
  const RealtimeOptions& asked = machine.config.realtime;
  const int wanted = std::max({asked.priority, asked.camera_priority, 1});
  const auto limit = files.limit("Max realtime priority");
  const bool capable = files.capability(CAP_SYS_NICE);
  Check check;
  check.found =
      fmt::format("RLIMIT_RTPRIO is {}, {} CAP_SYS_NICE",
                  limit ? std::to_string(*limit) : "unlimited", capable ? "with" : "without");
  if (capable || !limit || *limit >= wanted) return check;
  check.verdict = CheckVerdict::kBad;
  check.advice = fmt::format(
      "priority {} will be refused; allow it (the packaged service is allowed it by its unit)",
      wanted);
  check.commands = {limit_command("rtprio 99")};
  return check;
}

Check check_memlock(const Machine&, const MachineFiles& files) {
  const auto limit = files.limit("Max locked memory");
  const bool capable = files.capability(CAP_IPC_LOCK);
  Check check;
  check.found =
      fmt::format("RLIMIT_MEMLOCK is {}, {} CAP_IPC_LOCK",
                  limit ? fmt::format("{:.3g} MB", static_cast<double>(*limit) / (1 << 20))
                        : std::string("unlimited"),
                  capable ? "with" : "without");
  if (capable || !limit) return check;
  check.verdict = CheckVerdict::kBad;
  check.advice = "lock_memory will be refused; lift the limit (the packaged service has none)";
  check.commands = {limit_command("memlock unlimited")};
  return check;
}

Check check_dma_latency(const Machine&, const MachineFiles& files) {
  constexpr const char* kDevice = "/dev/cpu_dma_latency";
  Check check;
  if (!files.exists(kDevice)) {
    check.verdict = CheckVerdict::kNotSeen;
    check.found = fmt::format("there is no {}", kDevice);
    return check;
  }
  const bool writable = files.writable(kDevice);
  check.found = fmt::format("{} is {}", kDevice, writable ? "writable" : "not writable");
  if (writable) return check;
  check.verdict = CheckVerdict::kCouldBeBetter;
  check.advice = "max_cpu_wakeup_us will be refused; let this user write it";
  check.commands = {fmt::format("sudo setfacl -m u:$USER:rw {}", kDevice)};
  return check;
}

}  // namespace curlew
