#include "acquisition/aravis/stream_socket.h"

#include <arpa/inet.h>
#include <linux/filter.h>
#include <linux/sock_diag.h>
#include <netinet/in.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <filesystem>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "core/error.h"

namespace curlew {
namespace {

bool is_udp_on_port(int fd, int port) {
  int type = 0;
  socklen_t length = sizeof type;
  if (getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &length) != 0 || type != SOCK_DGRAM) return false;
  sockaddr_in address{};
  length = sizeof address;
  return getsockname(fd, reinterpret_cast<sockaddr*>(&address), &length) == 0 &&
         address.sin_family == AF_INET && ntohs(address.sin_port) == port;
}

int find_socket(int port) {
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd", error)) {
    const std::string name = entry.path().filename().string();
    int fd = -1;
    std::from_chars(name.data(), name.data() + name.size(), fd);
    if (fd >= 0 && is_udp_on_port(fd, port)) return fd;
  }
  return -1;
}

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

std::int64_t packets_refused(int fd) {
  std::array<std::uint32_t, SK_MEMINFO_VARS> numbers{};
  socklen_t length = sizeof numbers;
  if (fd < 0 || getsockopt(fd, SOL_SOCKET, SO_MEMINFO, numbers.data(), &length) != 0) return 0;
  return numbers[SK_MEMINFO_DROPS];
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
  const int fd = find_socket(port);
  if (fd < 0 || inet_pton(AF_INET, sender.address.c_str(), &address) != 1)
    throw Failure("the socket for the frames of " + sender.address + " cannot be found");
  std::vector<sock_filter> program = camera_filter(ntohl(address.s_addr), sender.port);
  const sock_fprog filter{static_cast<unsigned short>(program.size()), program.data()};
  if (setsockopt(fd, SOL_SOCKET, SO_ATTACH_FILTER, &filter, sizeof filter) != 0)
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
