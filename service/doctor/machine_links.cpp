#include <spdlog/fmt/fmt.h>

#include <sstream>

#include "service/doctor/machine_check_list.h"

namespace curlew {
namespace {

constexpr const char* kNet = "/sys/class/net/";

/// Network interfaces that are up and are hardware, as far as a machine has any.
std::vector<std::string> interfaces(const MachineFiles& files) {
  std::vector<std::string> up;
  for (const std::string& name : files.names(kNet, ""))
    if (files.exists(kNet + name + "/device") &&
        files.text(kNet + name + "/operstate").value_or("unknown") != "down")
      up.push_back(name);
  return up;
}

/// What is so of one interface, and the command that mends it.
struct InterfaceFinding {
  std::string found;
  bool good;
  std::string command;
};

/// find(name) of every interface; advice where one is not good.
template <typename Find>
Check check_interfaces(const MachineFiles& files, const char* advice, Find find) {
  Check check;
  for (const std::string& name : interfaces(files)) {
    const InterfaceFinding finding = find(name);
    check.found += (check.found.empty() ? "" : "; ") + finding.found;
    if (finding.good) continue;
    check.verdict = Verdict::kCouldBeBetter;
    check.advice = advice;
    check.commands.push_back(finding.command);
  }
  if (check.found.empty()) {
    check.verdict = Verdict::kNotSeen;
    check.found = "no network interface but loopback";
  }
  return check;
}

/// A column of the Udp lines of /proc/net/snmp: names in the first, values in the second.
std::int64_t udp_counter(const MachineFiles& files, const std::string& wanted) {
  std::istringstream lines(files.text("/proc/net/snmp").value_or(""));
  std::string names, values;
  for (std::string line; std::getline(lines, line);)
    if (line.rfind("Udp: ", 0) == 0) (names.empty() ? names : values) = line.substr(5);
  std::istringstream name_list(names), value_list(values);
  std::string name;
  std::int64_t value = 0;
  while (name_list >> name && value_list >> value)
    if (name == wanted) return value;
  return 0;
}

}  // namespace

Check check_socket_buffer(const Machine& machine, const MachineFiles& files) {
  // At 128 x 128 Mono16 and 1 kHz less than this lost frames.
  constexpr std::int64_t kTooSmall_bytes = 1 << 20;
  const std::int64_t wanted_bytes = machine.config.camera.socket_buffer_bytes;
  const auto max_bytes = files.number("/proc/sys/net/core/rmem_max");
  Check check;
  if (!max_bytes) {
    check.verdict = Verdict::kNotSeen;
    check.found = "net.core.rmem_max cannot be seen here";
    return check;
  }
  check.found = fmt::format("net.core.rmem_max is {}, [camera] socket_buffer_bytes {}", *max_bytes,
                            wanted_bytes);
  if (*max_bytes >= wanted_bytes) return check;
  check.verdict = *max_bytes < kTooSmall_bytes ? Verdict::kBad : Verdict::kCouldBeBetter;
  check.advice = "packets that find the buffer full are lost";
  check.commands = {
      fmt::format("echo net.core.rmem_max={} | sudo tee "
                  "/etc/sysctl.d/91-curlew.conf && sudo sysctl --system",
                  wanted_bytes)};
  return check;
}

Check check_jumbo_frames(const Machine&, const MachineFiles& files) {
  constexpr std::int64_t kJumbo_bytes = 8000;
  return check_interfaces(
      files, "large packets halve the CPU's work; on the camera's interface only",
      [&](const std::string& name) -> InterfaceFinding {
        const std::int64_t mtu_bytes = files.number(kNet + name + "/mtu").value_or(0);
        return {fmt::format("{} MTU {}", name, mtu_bytes), mtu_bytes >= kJumbo_bytes,
                fmt::format("sudo ip link set {} mtu 9000", name)};
      });
}

Check check_packet_loss(const Machine&, const MachineFiles& files) {
  const std::int64_t full = udp_counter(files, "RcvbufErrors");
  const std::int64_t bad = udp_counter(files, "InErrors");
  Check check;
  if (!files.exists("/proc/net/snmp")) {
    check.verdict = Verdict::kNotSeen;
    check.found = "/proc/net/snmp cannot be seen here";
    return check;
  }
  check.found = fmt::format(
      "since start: {} datagrams received, {} lost, {} of them by a full "
      "socket buffer",
      udp_counter(files, "InDatagrams"), bad, full);
  if (bad == 0 && full == 0) return check;
  check.verdict = Verdict::kCouldBeBetter;
  check.advice = full > 0 ? "a larger [camera] socket_buffer_bytes, or a [realtime] "
                            "camera_priority, if the number grows while streaming"
                          : "look at cable and switch if the number grows while streaming";
  return check;
}

Check check_interface_losses(const Machine&, const MachineFiles& files) {
  // Some drops are only packets of protocols nobody here speaks.
  constexpr double kHarmless = 1e-3;
  return check_interfaces(
      files, "give the interface a longer receive queue",
      [&](const std::string& name) -> InterfaceFinding {
        const std::string folder = kNet + name + "/statistics/";
        const std::int64_t packets = files.number(folder + "rx_packets").value_or(0);
        const std::int64_t dropped = files.number(folder + "rx_dropped").value_or(0);
        const std::int64_t missed = files.number(folder + "rx_missed_errors").value_or(0);
        return {
            fmt::format("{}: {} packets, {} dropped, {} missed", name, packets, dropped, missed),
            missed == 0 && static_cast<double>(dropped) <= kHarmless * static_cast<double>(packets),
            fmt::format("sudo ethtool -G {} rx 4096", name)};
      });
}

Check check_usb_memory(const Machine&, const MachineFiles& files) {
  constexpr const char* kSetting = "/sys/module/usbcore/parameters/usbfs_memory_mb";
  constexpr std::int64_t kEnough_mb = 256;
  const auto limit_mb = files.number(kSetting);
  Check check;
  if (!limit_mb) {
    check.verdict = Verdict::kNotSeen;
    check.found = "the kernel has no USB, or does not show it here";
    return check;
  }
  check.found = *limit_mb == 0 ? std::string("usbfs_memory_mb is 0: no limit")
                               : fmt::format("usbfs_memory_mb is {}", *limit_mb);
  if (*limit_mb == 0 || *limit_mb >= kEnough_mb) return check;
  check.verdict = Verdict::kCouldBeBetter;
  check.advice = "transfers of a few large frames do not fit";
  check.commands = {fmt::format("echo 1000 | sudo tee {}", kSetting)};
  return check;
}

}  // namespace curlew
