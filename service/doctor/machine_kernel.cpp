#include <spdlog/fmt/fmt.h>

#include <sstream>

#include "service/doctor/machine_check_list.h"

namespace curlew {

Check check_kernel(const Machine&, const MachineFiles& files) {
  std::istringstream version(files.text("/proc/version").value_or(""));
  std::string release;
  version >> release >> release >> release;  // "Linux version RELEASE …"
  const bool rt = files.number("/sys/kernel/realtime").value_or(0) == 1 ||
                  version.str().find("PREEMPT_RT") != std::string::npos;
  Check check;
  check.found = fmt::format("Linux {}, {} PREEMPT_RT", release, rt ? "with" : "without");
  if (rt) return check;
  check.verdict = CheckVerdict::kCouldBeBetter;
  check.advice = "a PREEMPT_RT kernel shortens the longest wake-ups";
  check.commands = {"sudo apt install linux-image-rt-$(dpkg --print-architecture)  # then reboot"};
  return check;
}

Check check_rt_throttling(const Machine&, const MachineFiles& files) {
  const auto runtime_us = files.number("/proc/sys/kernel/sched_rt_runtime_us");
  const auto period_us = files.number("/proc/sys/kernel/sched_rt_period_us").value_or(1000000);
  Check check;
  if (!runtime_us) {
    check.verdict = CheckVerdict::kNotSeen;
    check.found = "sched_rt_runtime_us cannot be seen here";
    return check;
  }
  // The kernel usually allows 95 %. That is a safety net and no obstacle, because the pipeline's
  // waits are bounded.
  constexpr double kUsual = 0.9;
  check.found =
      *runtime_us < 0
          ? std::string("sched_rt_runtime_us is -1: real-time threads are never stopped")
          : fmt::format("real-time threads may use {:.0f} % of a CPU (sched_rt_runtime_us {})",
                        100.0 * static_cast<double>(*runtime_us) / static_cast<double>(period_us),
                        *runtime_us);
  if (*runtime_us < 0 ||
      static_cast<double>(*runtime_us) >= kUsual * static_cast<double>(period_us))
    return check;
  check.verdict = *runtime_us == 0 ? CheckVerdict::kBad : CheckVerdict::kCouldBeBetter;
  check.advice = "the kernel stops real-time threads that use more";
  check.commands = {
      fmt::format("sudo sysctl -w kernel.sched_rt_runtime_us={}", period_us / 100 * 95)};
  return check;
}

Check check_clock_source(const Machine&, const MachineFiles& files) {
  const std::string folder = "/sys/devices/system/clocksource/clocksource0/";
  const auto source = files.text(folder + "current_clocksource");
  Check check;
  check.found = source.value_or("cannot be seen here");
  if (!source) {
    check.verdict = CheckVerdict::kNotSeen;
    return check;
  }
  // These clocks are read without a system call.
  for (const char* fast : {"tsc", "kvm-clock", "arch_sys_counter", "hyperv_clocksource_tsc_page"})
    if (*source == fast) return check;
  check.verdict = CheckVerdict::kBad;
  check.advice = "reading it is a system call or a slow device";
  const auto choice = files.text(folder + "available_clocksource").value_or("");
  if (choice.rfind("tsc", 0) == 0 || choice.find(" tsc") != std::string::npos)
    check.commands = {fmt::format("echo tsc | sudo tee {}current_clocksource", folder)};
  else
    check.advice += "; the kernel trusts no better one here (see dmesg on tsc)";
  return check;
}

Check check_huge_pages(const Machine&, const MachineFiles& files) {
  constexpr const char* kSetting = "/sys/kernel/mm/transparent_hugepage/enabled";
  const std::string setting = files.text(kSetting).value_or("");
  Check check;
  if (setting.empty()) {
    check.verdict = CheckVerdict::kNotSeen;
    check.found = "the kernel has no transparent huge pages";
    return check;
  }
  check.found = fmt::format("transparent huge pages: {}", setting);
  if (setting.find("[madvise]") != std::string::npos) return check;
  check.verdict = CheckVerdict::kCouldBeBetter;
  check.advice =
      setting.find("[never]") != std::string::npos
          ? "huge_pages may have no effect; let programs ask for them"
          : "let programs ask for them, so that the kernel does not collect them unasked";
  check.commands = {fmt::format("echo madvise | sudo tee {}", kSetting)};
  return check;
}

Check check_swap(const Machine& machine, const MachineFiles& files) {
  std::istringstream swaps(files.text("/proc/swaps").value_or(""));
  std::string line;
  std::getline(swaps, line);  // the heading
  int count = 0;
  while (std::getline(swaps, line)) count += line.empty() ? 0 : 1;
  Check check;
  check.found = count == 0 ? "no swap" : "the machine has swap";
  if (count == 0) return check;
  if (machine.config.realtime.lock_memory) {
    check.found += "; the configuration locks the program's memory";
    return check;
  }
  check.verdict = CheckVerdict::kCouldBeBetter;
  check.advice = "set [realtime] lock_memory = true, or switch swap off";
  check.commands = {"sudo swapoff -a"};
  return check;
}

}  // namespace curlew
