#include "acquisition/aravis/aravis_network.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cstdint>

namespace curlew {

bool gige_device_answers(const std::string& address) {
  sockaddr_in device{};
  device.sin_family = AF_INET;
  device.sin_port = htons(kGigeControlPort);
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

}  // namespace curlew
