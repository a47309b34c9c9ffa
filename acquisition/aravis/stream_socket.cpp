#include "acquisition/aravis/stream_socket.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "acquisition/aravis/socket_filter.h"
#include "core/error.h"

namespace curlew {
namespace {

constexpr std::uint32_t kUdpHeader = 8;  // bytes; the filter sees the packet from there on
// These are bytes of GVSP's header, and where in it is what the packet holds.
constexpr std::uint32_t kHeader = 8;
constexpr std::uint32_t kExtendedHeader = 20;  // that of packets with long frame numbers
constexpr std::uint32_t kContentAt = kUdpHeader + 4;
constexpr std::uint32_t kIsExtended = 0x80;
constexpr std::uint32_t kContentMask = 0x7f;
// What the packet must hold behind the header, at least.
constexpr std::uint32_t kLeader = 1, kLeaderBytes = 36;
constexpr std::uint32_t kTrailer = 2, kTrailerBytes = 4;
constexpr std::uint32_t kPayload = 3, kPayloadBytes = 1;
constexpr std::uint32_t kAddressAt = 12;  // in the IP header

/// Returns the program (BPF) that the kernel runs on every packet. A packet that is shorter than
/// what the program looks at is refused.
std::vector<sock_filter> camera_filter(std::uint32_t address, std::uint16_t port) {
  constexpr std::uint16_t kLoadWord = BPF_LD | BPF_W | BPF_ABS;
  constexpr std::uint16_t kLoadHalf = BPF_LD | BPF_H | BPF_ABS;
  constexpr std::uint16_t kLoadByte = BPF_LD | BPF_B | BPF_ABS;
  constexpr std::uint16_t kLoadLength = BPF_LD | BPF_W | BPF_LEN;
  constexpr std::uint16_t kEqual = BPF_JMP | BPF_JEQ | BPF_K;
  constexpr std::uint16_t kAtLeast = BPF_JMP | BPF_JGE | BPF_K;
  constexpr std::uint16_t kReturn = BPF_RET | BPF_K;
  constexpr auto net = static_cast<std::uint32_t>(SKF_NET_OFF);
  std::vector<sock_filter> program;
  const auto add = [&](std::uint16_t code, std::uint32_t k, std::uint8_t yes = 0,
                       std::uint8_t no = 0) {
    program.push_back({code, yes, no, k});
  };
  // Goes on where it holds; otherwise the packet is refused.
  const auto require = [&](std::uint16_t code, std::uint32_t k) {
    add(code, k, 1, 0);
    add(kReturn, 0);
  };
  add(kLoadWord, net + kAddressAt);
  require(kEqual, address);
  if (port != 0) {
    add(kLoadHalf, 0);
    require(kEqual, port);
  }
  // X becomes the length of GVSP's header.
  add(BPF_LDX | BPF_IMM, kHeader);
  add(kLoadByte, kContentAt);
  add(BPF_JMP | BPF_JSET | BPF_K, kIsExtended, 0, 1);
  add(BPF_LDX | BPF_IMM, kExtendedHeader);
  // M[0] becomes the number of bytes behind the header.
  add(kLoadLength, 0);
  add(BPF_ALU | BPF_SUB | BPF_K, kUdpHeader);
  add(BPF_JMP | BPF_JGT | BPF_X, 0, 1, 0);
  add(kReturn, 0);
  add(BPF_ALU | BPF_SUB | BPF_X, 0);
  add(BPF_ST, 0);
  constexpr std::pair<std::uint32_t, std::uint32_t> contents[] = {
      {kLeader, kLeaderBytes}, {kTrailer, kTrailerBytes}, {kPayload, kPayloadBytes}};
  for (const auto& [content, bytes] : contents) {
    add(kLoadByte, kContentAt);
    add(BPF_ALU | BPF_AND | BPF_K, kContentMask);
    add(kEqual, content, 0, 4);
    add(BPF_LD | BPF_MEM, 0);
    require(kAtLeast, bytes);
    add(kReturn, 0xffffffffU);
  }
  add(kReturn, 0);
  return program;
}

/// Waits until Aravis' thread has read what came before the filter; a tenth of a second at most.
void drain(int fd) {
  int waiting = 1;
  for (int i = 0; i < 100 && ioctl(fd, FIONREAD, &waiting) == 0 && waiting > 0; ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
}

}  // namespace

void StreamSocket::guard(int port, const StreamSender& sender) {
  in_addr address{};
  const std::vector<UdpSocket> sockets = udp_sockets();
  const auto found = std::find_if(sockets.begin(), sockets.end(),
                                  [&](const UdpSocket& socket) { return socket.port == port; });
  const int fd = found == sockets.end() ? -1 : found->fd;
  if (fd < 0 || inet_pton(AF_INET, sender.address.c_str(), &address) != 1)
    throw Failure("the socket for the frames of " + sender.address + " cannot be found");
  if (!attach_filter(fd, camera_filter(ntohl(address.s_addr), sender.port)))
    throw Failure("the kernel does not let the socket for the frames of " + sender.address +
                  " be guarded against others: " + std::generic_category().message(errno));
  drain(fd);
  const std::lock_guard lock(mutex_);
  fd_ = fd;
}

int StreamSocket::set_receive_buffer(int bytes) const {
  const std::lock_guard lock(mutex_);
  setsockopt(fd_, SOL_SOCKET, SO_RCVBUF, &bytes, sizeof bytes);
  int doubled = 0;  // The kernel counts its own overhead in.
  socklen_t length = sizeof doubled;
  getsockopt(fd_, SOL_SOCKET, SO_RCVBUF, &doubled, &length);
  return doubled / 2;
}

void StreamSocket::forget() {
  const std::lock_guard lock(mutex_);
  refused_before_ += packets_refused(std::exchange(fd_, -1));
}

std::int64_t StreamSocket::refused() const {
  const std::lock_guard lock(mutex_);
  return refused_before_ + packets_refused(fd_);
}

}  // namespace curlew
