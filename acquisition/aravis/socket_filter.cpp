#include "acquisition/aravis/socket_filter.h"

#include <arpa/inet.h>
#include <linux/sock_diag.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <filesystem>
#include <optional>
#include <system_error>

#include "acquisition/aravis/aravis_network.h"
#include "core/error.h"

namespace curlew {
namespace {

/// Returns the port of a UDP socket; nothing if it is none.
std::optional<int> udp_port(int fd) {
  int type = 0;
  socklen_t length = sizeof type;
  if (getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &length) != 0 || type != SOCK_DGRAM) return {};
  sockaddr_in address{};
  length = sizeof address;
  if (getsockname(fd, reinterpret_cast<sockaddr*>(&address), &length) != 0 ||
      address.sin_family != AF_INET)
    return {};
  return ntohs(address.sin_port);
}

/// Returns the program that lets packets through from one address and port. It sees them from the
/// header of UDP on, which begins with the sender's port.
std::vector<sock_filter> sender_filter(std::uint32_t address, std::uint16_t port) {
  constexpr auto kSenderAt = static_cast<std::uint32_t>(SKF_NET_OFF) + 12;  // in the IP header
  return {{BPF_LD | BPF_W | BPF_ABS, 0, 0, kSenderAt}, {BPF_JMP | BPF_JEQ | BPF_K, 0, 3, address},
          {BPF_LD | BPF_H | BPF_ABS, 0, 0, 0},         {BPF_JMP | BPF_JEQ | BPF_K, 0, 1, port},
          {BPF_RET | BPF_K, 0, 0, 0xffffffffU},        {BPF_RET | BPF_K, 0, 0, 0}};
}

}  // namespace

std::vector<UdpSocket> udp_sockets() {
  std::vector<UdpSocket> sockets;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd", error)) {
    const std::string name = entry.path().filename().string();
    int fd = -1;
    std::from_chars(name.data(), name.data() + name.size(), fd);
    if (fd < 0) continue;
    if (const std::optional<int> port = udp_port(fd)) sockets.push_back({fd, *port});
  }
  return sockets;
}

bool attach_filter(int fd, std::vector<sock_filter> program) {
  const sock_fprog filter{static_cast<unsigned short>(program.size()), program.data()};
  return setsockopt(fd, SOL_SOCKET, SO_ATTACH_FILTER, &filter, sizeof filter) == 0;
}

std::int64_t packets_refused(int fd) {
  std::array<std::uint32_t, SK_MEMINFO_VARS> numbers{};
  socklen_t length = sizeof numbers;
  if (fd < 0 || getsockopt(fd, SOL_SOCKET, SO_MEMINFO, numbers.data(), &length) != 0) return 0;
  return numbers[SK_MEMINFO_DROPS];
}

int guard_control_channel(const std::vector<UdpSocket>& before, const std::string& address) {
  in_addr camera{};
  const std::vector<UdpSocket> sockets = udp_sockets();
  const auto fresh = std::find_if(sockets.begin(), sockets.end(), [&](const UdpSocket& socket) {
    return std::find(before.begin(), before.end(), socket) == before.end();
  });
  if (fresh == sockets.end() || inet_pton(AF_INET, address.c_str(), &camera) != 1)
    throw Failure("the socket for the answers of " + address + " cannot be found");
  if (!attach_filter(fresh->fd, sender_filter(ntohl(camera.s_addr), kGigeControlPort)))
    throw Failure("the kernel does not let the socket for the answers of " + address +
                  " be guarded against others: " + std::generic_category().message(errno));
  // Where it is the heartbeat's answer that goes, Aravis asks again.
  std::array<char, 1> rest{};
  constexpr int kMostWaiting = 100'000;
  for (int i = 0; i < kMostWaiting && recv(fresh->fd, rest.data(), rest.size(), MSG_DONTWAIT) >= 0;)
    ++i;
  return fresh->fd;
}

}  // namespace curlew
