#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <set>

#include "service/doctor/machine_check_list.h"
#include "service/realtime/cpu_list.h"

namespace curlew {
namespace {

constexpr const char* kCpus = "/sys/devices/system/cpu/";

std::string or_none(const std::string& text) { return text.empty() ? "none" : text; }

std::vector<int> chosen_cpus(const Config& config) {
  std::vector<int> cpus = config.pipeline.cpus;
  cpus.insert(cpus.end(), config.realtime.camera_cpus.begin(), config.realtime.camera_cpus.end());
  std::sort(cpus.begin(), cpus.end());
  cpus.erase(std::unique(cpus.begin(), cpus.end()), cpus.end());
  return cpus;
}

std::vector<int> without(const std::vector<int>& cpus, const std::vector<int>& those) {
  std::vector<int> rest;
  std::copy_if(cpus.begin(), cpus.end(), std::back_inserter(rest),
               [&](int cpu) { return std::find(those.begin(), those.end(), cpu) == those.end(); });
  return rest;
}

}  // namespace

Check check_cpu_count(const Machine&, const MachineFiles& files) {
  const std::vector<int> online = files.online_cpus();
  const bool siblings = files.number(std::string(kCpus) + "smt/active").value_or(0) == 1;
  Check check;
  check.found = fmt::format("{} CPUs ({}){}", online.size(), or_none(cpu_text(online)),
                            siblings ? ", two or more share a core (SMT)" : ", a core each");
  if (online.empty()) {
    check.verdict = CheckVerdict::kNotSeen;
    check.found = "the kernel does not list the CPUs";
  } else if (online.size() < 2) {
    check.verdict = CheckVerdict::kBad;
    check.advice = "camera, pipeline and all other work share one CPU; use a machine with more";
  } else if (siblings) {
    check.verdict = CheckVerdict::kCouldBeBetter;
    check.advice = "a sibling's work slows its core; switch SMT off, or leave siblings idle";
    check.commands = {"echo off | sudo tee /sys/devices/system/cpu/smt/control"};
  }
  return check;
}

Check check_chosen_cpus(const Machine& machine, const MachineFiles& files) {
  const std::vector<int> chosen = chosen_cpus(machine.config);
  const std::vector<int> missing = without(chosen, files.online_cpus());
  Check check;
  if (chosen.empty()) {
    check.verdict = CheckVerdict::kCouldBeBetter;
    check.found = "the configuration binds no thread to a CPU";
    check.advice = "set [pipeline] cpus and [realtime] camera_cpus";
    return check;
  }
  check.found = fmt::format("the configuration uses CPU {}", cpu_text(chosen));
  if (missing.empty()) return check;
  check.verdict = CheckVerdict::kBad;
  check.advice = fmt::format(
      "CPU {} is not there; correct [pipeline] cpus and [realtime] camera_cpus", cpu_text(missing));
  return check;
}

Check check_isolation(const Machine& machine, const MachineFiles& files) {
  constexpr std::size_t kEnoughToIsolate = 4;
  const auto isolated = cpus_from(files.text(std::string(kCpus) + "isolated").value_or(""));
  const auto tickless = cpus_from(files.text(std::string(kCpus) + "nohz_full").value_or(""));
  const std::vector<int> online = files.online_cpus();
  Check check;
  check.found = fmt::format("isolated: {}, without ticks (nohz_full): {}",
                            or_none(cpu_text(isolated)), or_none(cpu_text(tickless)));
  const std::vector<int> disturbed = without(chosen_cpus(machine.config), isolated);
  if (!isolated.empty() && disturbed.empty()) return check;
  if (!isolated.empty()) {
    check.verdict = CheckVerdict::kCouldBeBetter;
    check.advice = fmt::format("the configuration uses CPU {}, which other work uses too",
                               cpu_text(disturbed));
    return check;
  }
  if (online.size() < kEnoughToIsolate) {
    check.found += "; with so few CPUs better so";
    return check;
  }
  const auto half = static_cast<std::ptrdiff_t>(online.size() / 2);
  const std::string cpus = cpu_text({online.begin() + half, online.end()});
  check.verdict = CheckVerdict::kCouldBeBetter;
  check.advice =
      fmt::format("keep other work off some CPUs, {} for one, and bind the threads to them", cpus);
  check.commands = {
      fmt::format("echo 'GRUB_CMDLINE_LINUX_DEFAULT=\"$GRUB_CMDLINE_LINUX_DEFAULT "
                  "isolcpus={0} nohz_full={0} rcu_nocbs={0}\"' | sudo tee "
                  "/etc/default/grub.d/curlew.cfg && sudo update-grub  # then reboot",
                  cpus)};
  return check;
}

Check check_governor(const Machine&, const MachineFiles& files) {
  std::set<std::string> governors;
  for (const std::string& cpu : files.names(kCpus, "cpu"))
    if (const auto governor = files.text(kCpus + cpu + "/cpufreq/scaling_governor"))
      governors.insert(*governor);
  Check check;
  if (governors.empty()) {
    check.verdict = CheckVerdict::kNotSeen;
    check.found = "governor and turbo cannot be seen here";
    return check;
  }
  check.found = fmt::format("governor {}", fmt::join(governors, ", "));
  const auto no_turbo = files.number(std::string(kCpus) + "intel_pstate/no_turbo");
  const auto boost = files.number(std::string(kCpus) + "cpufreq/boost");
  if (no_turbo || boost) check.found += no_turbo == 1 || boost == 0 ? ", turbo off" : ", turbo on";
  if (governors == std::set<std::string>{"performance"}) return check;
  check.verdict = CheckVerdict::kBad;
  check.advice = "a CPU that slows down between frames is slow when one comes";
  check.commands = {
      "echo performance | sudo tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor"};
  return check;
}

Check check_c_states(const Machine& machine, const MachineFiles& files) {
  constexpr std::int64_t kLongWakeup_us = 20;
  const std::string folder = std::string(kCpus) + "cpu0/cpuidle/";
  std::string deepest;
  std::int64_t wakeup_us = -1;
  for (const std::string& state : files.names(folder, "state")) {
    const std::int64_t latency_us = files.number(folder + state + "/latency").value_or(0);
    if (files.number(folder + state + "/disable").value_or(0) != 0 || latency_us < wakeup_us)
      continue;
    wakeup_us = latency_us;
    deepest = files.text(folder + state + "/name").value_or(state);
  }
  Check check;
  if (wakeup_us < 0) {
    check.verdict = CheckVerdict::kNotSeen;
    check.found = "C-states cannot be seen here";
    return check;
  }
  check.found = fmt::format("the deepest is {}, {} µs to wake up from", deepest, wakeup_us);
  const int hold_us = machine.config.realtime.max_cpu_wakeup_us;
  if (hold_us >= 0) check.found += fmt::format("; the configuration holds it to {} µs", hold_us);
  if (wakeup_us <= kLongWakeup_us || hold_us >= 0) return check;
  check.verdict = CheckVerdict::kCouldBeBetter;
  check.advice = "set [realtime] max_cpu_wakeup_us = 0, or a few µs";
  return check;
}

Check check_virtual(const Machine&, const MachineFiles& files) {
  const std::string flags = files.line("/proc/cpuinfo", "flags").value_or("");
  const bool is_virtual = (flags + " ").find(" hypervisor ") != std::string::npos;
  Check check;
  check.found = is_virtual ? "a virtual machine" : "no virtual machine seen";
  if (is_virtual) {
    check.verdict = CheckVerdict::kCouldBeBetter;
    check.advice = "its host's other work adds jitter that nothing in here can cure";
  }
  return check;
}

}  // namespace curlew
