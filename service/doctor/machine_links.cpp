#include <arpa/inet.h>
#include <spdlog/fmt/fmt.h>

#include <bit>
#include <optional>
#include <sstream>

#include "service/doctor/machine_check_list.h"

namespace curlew {
namespace {

constexpr const char* kNet = "/sys/class/net/";

/// Returns the network interfaces that are hardware and not down.
std::vector<std::string> interfaces(const MachineFiles& files) {
  std::vector<std::string> up;
  for (const std::string& name : files.names(kNet, ""))
    if (files.exists(kNet + name + "/device") &&
        files.text(kNet + name + "/operstate").value_or("unknown") != "down")
      up.push_back(name);
  return up;
}

/// A line of /proc/net/route: an IPv4 network, with its bytes in network order, and the interface
/// that leads there.
struct Route {
  std::string interface;
  std::uint32_t destination = 0;
  std::uint32_t mask = 0;
  unsigned flags = 0;
  int metric = 0;
};

std::vector<Route> routes(const MachineFiles& files) {
  std::istringstream lines(files.text("/proc/net/route").value_or(""));
  std::vector<Route> all;
  std::string line, skipped;
  std::getline(lines, line);  // the columns' names
  while (std::getline(lines, line)) {
    std::istringstream words(line);
    Route route;
    words >> route.interface >> std::hex >> route.destination >> skipped >> route.flags >>
        skipped >> skipped >> std::dec >> route.metric >> std::hex >> route.mask;
    if (words) all.push_back(route);
  }
  return all;
}

/// Returns the interface whose network holds the address, or by which a route leads there. Default
/// routes do not count: they lead everywhere, and so do not tell where the camera is.
std::optional<std::string> interface_towards(const MachineFiles& files, std::uint32_t address) {
  constexpr unsigned kUp = 0x1, kReject = 0x200;  // as in linux/route.h
  // Two routes with shorter prefixes can make up a default route.
  constexpr int kShortestPrefix = 8;
  constexpr std::uint32_t kLoopback = 127;
  if (ntohl(address) >> 24 == kLoopback) return "lo";  // loopback has a routing table of its own
  std::optional<Route> best;
  const auto prefix = [](const Route& route) { return std::popcount(route.mask); };
  for (const Route& route : routes(files)) {
    if ((route.flags & kUp) == 0 || (route.flags & kReject) != 0) continue;
    if (prefix(route) < kShortestPrefix || (address & route.mask) != route.destination) continue;
    if (!best || prefix(route) > prefix(*best) ||
        (prefix(route) == prefix(*best) && route.metric < best->metric))
      best = route;
  }
  if (!best) return std::nullopt;
  return best->interface;
}

/// How the camera is attached, as far as [camera] source and the routes tell.
struct CameraLink {
  bool on_network = true;
  std::string interface;  ///< empty: unknown
  std::string sentence;   ///< why it is this interface, or why it is unknown
};

CameraLink camera_link(const Machine& machine, const MachineFiles& files) {
  const std::string& source = machine.config.camera.source;
  const std::string aravis = "aravis:";
  CameraLink link;
  in_addr address{};
  if (source.rfind(aravis, 0) != 0) {
    link.on_network = false;
    link.sentence = fmt::format("the camera {} is not on a network", source);
    return link;
  }
  const std::string id = source.substr(aravis.size());
  if (inet_pton(AF_INET, id.c_str(), &address) != 1) {
    link.sentence = fmt::format(
        "which interface is the camera's cannot be known from [camera] source \"{}\", but could be "
        "from its IP address",
        source);
    return link;
  }
  link.interface = interface_towards(files, address.s_addr).value_or("");
  if (link.interface.empty())
    link.sentence = fmt::format(
        "no interface has the network of the camera {}: give the camera's interface an address in "
        "it",
        id);
  else
    link.sentence = fmt::format("on the way to the camera {}", id);
  return link;
}

/// What was found about one interface.
struct InterfaceFinding {
  std::string found;
  bool good;
};

/// Collects find(name) of the camera's interface, or of all interfaces if the camera's is unknown.
/// If one is not good, it adds advice and command(name). The command names no interface but the
/// camera's, because changing another one may cut somebody off.
template <typename Find, typename Command>
Check check_interfaces(const Machine& machine, const MachineFiles& files, const char* advice,
                       Find find, Command command) {
  const CameraLink link = camera_link(machine, files);
  const bool is_known = !link.interface.empty();
  Check check;
  if (!link.on_network) {
    check.found = link.sentence;
    return check;
  }
  bool all_good = true;
  for (const std::string& name :
       is_known ? std::vector<std::string>{link.interface} : interfaces(files)) {
    const InterfaceFinding finding = find(name);
    check.found += (check.found.empty() ? "" : "; ") + finding.found;
    all_good = all_good && finding.good;
  }
  if (check.found.empty()) {
    check.verdict = CheckVerdict::kNotSeen;
    check.found = "no network interface but loopback";
    return check;
  }
  if (is_known) check.found += ", " + link.sentence;
  if (all_good) return check;
  check.verdict = CheckVerdict::kCouldBeBetter;
  check.advice = advice;
  if (!is_known) check.advice += "; " + link.sentence;
  check.commands = {is_known ? command(link.interface)
                             : command("INTERFACE") + "  # INTERFACE: the camera's"};
  return check;
}

/// Returns a column of the Udp lines of /proc/net/snmp. The first has the names, the second the
/// values.
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

/// Returns the addresses that have answered on an interface, but for one.
std::vector<std::string> neighbours(const MachineFiles& files, const std::string& interface,
                                    const std::string& but_for) {
  constexpr unsigned kAnswered = 0x2;  // as in linux/if_arp.h
  std::istringstream lines(files.text("/proc/net/arp").value_or(""));
  std::vector<std::string> found;
  std::string line;
  std::getline(lines, line);  // the columns' names
  while (std::getline(lines, line)) {
    std::istringstream words(line);
    std::string address, skipped, device;
    unsigned flags = 0;
    words >> address >> skipped >> std::hex >> flags >> skipped >> skipped >> device;
    if (words && device == interface && (flags & kAnswered) != 0 && address != but_for)
      found.push_back(address);
  }
  return found;
}

}  // namespace

Check check_camera_network(const Machine& machine, const MachineFiles& files) {
  const CameraLink link = camera_link(machine, files);
  Check check;
  if (link.interface.empty() || link.interface == "lo") {
    check.found = link.interface.empty() ? link.sentence : "the camera is on this machine";
    return check;
  }
  std::string others;
  for (const Route& route : routes(files))
    if (route.interface == link.interface && route.mask == 0) others = "the default route";
  for (const std::string& address :
       neighbours(files, link.interface, machine.config.camera.source.substr(7)))
    others += (others.empty() ? "" : ", ") + address;
  if (others.empty()) {
    check.found = fmt::format("nobody but the camera is seen on {}", link.interface);
    return check;
  }
  check.verdict = CheckVerdict::kCouldBeBetter;
  check.found = fmt::format("{}, {}, is shared with {}", link.interface, link.sentence, others);
  check.advice =
      "GigE Vision has no password: whoever is on the camera's network can take the camera over or "
      "pretend to be it, and other traffic delays frames; give the camera an interface of its own";
  return check;
}

Check check_socket_buffer(const Machine& machine, const MachineFiles& files) {
  // With a smaller buffer, frames of 128 x 128 Mono16 were lost at 1 kHz.
  constexpr std::int64_t kTooSmall_bytes = 1 << 20;
  const std::int64_t wanted_bytes = machine.config.camera.socket_buffer_bytes;
  const auto max_bytes = files.number("/proc/sys/net/core/rmem_max");
  Check check;
  if (!max_bytes) {
    check.verdict = CheckVerdict::kNotSeen;
    check.found = "net.core.rmem_max cannot be seen here";
    return check;
  }
  check.found = fmt::format("net.core.rmem_max is {}, [camera] socket_buffer_bytes {}", *max_bytes,
                            wanted_bytes);
  if (*max_bytes >= wanted_bytes) return check;
  check.verdict = *max_bytes < kTooSmall_bytes ? CheckVerdict::kBad : CheckVerdict::kCouldBeBetter;
  check.advice = "packets that find the buffer full are lost";
  check.commands = {
      fmt::format("echo net.core.rmem_max={} | sudo tee "
                  "/etc/sysctl.d/91-curlew.conf && sudo sysctl --system",
                  wanted_bytes)};
  return check;
}

Check check_jumbo_frames(const Machine& machine, const MachineFiles& files) {
  constexpr std::int64_t kJumbo_bytes = 8000;
  return check_interfaces(
      machine, files,
      "large packets halve the CPU's work, where all that is on the camera's network takes them",
      [&](const std::string& name) -> InterfaceFinding {
        const std::int64_t mtu_bytes = files.number(kNet + name + "/mtu").value_or(0);
        return {fmt::format("{} MTU {}", name, mtu_bytes), mtu_bytes >= kJumbo_bytes};
      },
      [](const std::string& name) { return fmt::format("sudo ip link set {} mtu 9000", name); });
}

Check check_packet_loss(const Machine&, const MachineFiles& files) {
  const std::int64_t full = udp_counter(files, "RcvbufErrors");
  const std::int64_t bad = udp_counter(files, "InErrors");
  Check check;
  if (!files.exists("/proc/net/snmp")) {
    check.verdict = CheckVerdict::kNotSeen;
    check.found = "/proc/net/snmp cannot be seen here";
    return check;
  }
  check.found = fmt::format(
      "since start: {} datagrams received, {} lost, {} of them by a full "
      "socket buffer",
      udp_counter(files, "InDatagrams"), bad, full);
  if (bad == 0 && full == 0) return check;
  check.verdict = CheckVerdict::kCouldBeBetter;
  check.advice = full > 0 ? "a larger [camera] socket_buffer_bytes, or a [realtime] "
                            "camera_priority, if the number grows while streaming"
                          : "look at cable and switch if the number grows while streaming";
  return check;
}

Check check_interface_losses(const Machine& machine, const MachineFiles& files) {
  // A few drops are only packets of protocols that nobody here speaks.
  constexpr double kHarmless = 1e-3;
  return check_interfaces(
      machine, files, "give the camera's interface a longer receive queue",
      [&](const std::string& name) -> InterfaceFinding {
        const std::string folder = kNet + name + "/statistics/";
        const std::int64_t packets = files.number(folder + "rx_packets").value_or(0);
        const std::int64_t dropped = files.number(folder + "rx_dropped").value_or(0);
        const std::int64_t missed = files.number(folder + "rx_missed_errors").value_or(0);
        return {
            fmt::format("{}: {} packets, {} dropped, {} missed", name, packets, dropped, missed),
            missed == 0 &&
                static_cast<double>(dropped) <= kHarmless * static_cast<double>(packets)};
      },
      [](const std::string& name) { return fmt::format("sudo ethtool -G {} rx 4096", name); });
}

Check check_usb_memory(const Machine&, const MachineFiles& files) {
  constexpr const char* kSetting = "/sys/module/usbcore/parameters/usbfs_memory_mb";
  constexpr std::int64_t kEnough_mb = 256;
  const auto limit_mb = files.number(kSetting);
  Check check;
  if (!limit_mb) {
    check.verdict = CheckVerdict::kNotSeen;
    check.found = "the kernel has no USB, or does not show it here";
    return check;
  }
  check.found = *limit_mb == 0 ? std::string("usbfs_memory_mb is 0: no limit")
                               : fmt::format("usbfs_memory_mb is {}", *limit_mb);
  if (*limit_mb == 0 || *limit_mb >= kEnough_mb) return check;
  check.verdict = CheckVerdict::kCouldBeBetter;
  check.advice = "transfers of a few large frames do not fit";
  check.commands = {fmt::format("echo 1000 | sudo tee {}", kSetting)};
  return check;
}

}  // namespace curlew
