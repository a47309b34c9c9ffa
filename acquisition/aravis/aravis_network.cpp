#include "acquisition/aravis/aravis_network.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <charconv>
#include <cstdint>
#include <filesystem>
#include <system_error>

namespace curlew {
namespace {

constexpr std::uint16_t kControlPort = 3956;

bool is_udp_on_port(int fd, int port) {
  int type = 0;
  socklen_t length = sizeof type;
  if (getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &length) != 0 || type != SOCK_DGRAM) return false;
  sockaddr_in address{};
  length = sizeof address;
  return getsockname(fd, reinterpret_cast<sockaddr*>(&address), &length) == 0 &&
         address.sin_family == AF_INET && ntohs(address.sin_port) == port;
}

}  // namespace

bool gige_device_answers(const std::string& address) {
  sockaddr_in device{};
  device.sin_family = AF_INET;
  device.sin_port = htons(kControlPort);
  if (inet_pton(AF_INET, address.c_str(), &device.sin_addr) != 1) return false;
  const int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (fd < 0) return false;
  bool answered = false;
  // The socket is connected so that "port unreachable" is heard at once.
  if (connect(fd, reinterpret_cast<const sockaddr*>(&device), sizeof device) == 0) {
    // These are the key, the flag "answer me", the discovery command, no data, and request 1.
    constexpr std::array<std::uint8_t, 8> discovery{0x42, 0x01, 0x00, 0x02, 0x00, 0x00, 0x00, 0x01};
    std::array<std::uint8_t, 576> answer{};
    for (int attempt = 0; attempt < 3 && !answered; ++attempt) {
      if (send(fd, discovery.data(), discovery.size(), MSG_NOSIGNAL) < 0) break;
      pollfd poll_fd{fd, POLLIN, 0};
      if (poll(&poll_fd, 1, 100) > 0) {
        answered = recv(fd, answer.data(), answer.size(), MSG_DONTWAIT) > 0;
        if (!answered) break;
      }
    }
  }
  close(fd);
  return answered;
}

int set_receive_buffer(int port, int bytes) {
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd", error)) {
    const std::string name = entry.path().filename().string();
    int fd = -1;
    std::from_chars(name.data(), name.data() + name.size(), fd);
    if (fd < 0 || !is_udp_on_port(fd, port)) continue;
    setsockopt(fd, SOL_SOCKET, SO_RCVBUF, &bytes, sizeof bytes);
    int doubled = 0;  // The kernel counts its own overhead in.
    socklen_t length = sizeof doubled;
    getsockopt(fd, SOL_SOCKET, SO_RCVBUF, &doubled, &length);
    return doubled / 2;
  }
  return 0;
}

}  // namespace curlew
