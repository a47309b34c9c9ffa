#include "service/daemon/control_socket.h"

#include <poll.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <filesystem>
#include <system_error>

#include "core/error.h"

namespace curlew {
namespace {

// Whoever has connected must ask the question, and take the answer, within this time.
constexpr std::chrono::milliseconds kPatience{2000};
// Whoever asks waits this long for a part of the answer; some have to be made first.
constexpr int kPatienceForAnswer_ms = 10'000;

sockaddr_un address_of(const std::string& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.size() >= sizeof address.sun_path)
    throw UsageError("the control socket's path is too long, at most 107 characters: " + path);
  std::memcpy(address.sun_path, path.c_str(), path.size() + 1);
  return address;
}

/// This closes the descriptor at the end of its scope.
class Descriptor {
 public:
  explicit Descriptor(int fd) : fd_(fd) {}
  ~Descriptor() {
    if (fd_ >= 0) close(fd_);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  int fd() const { return fd_; }

 private:
  int fd_;
};

std::string last_error() { return std::error_code(errno, std::generic_category()).message(); }

/// Lets nobody who does not read, or does not accept, hold this process up.
void limit_waits(int fd) {
  constexpr timeval kLongest{kPatience.count() / 1000, 0};
  setsockopt(fd, SOL_SOCKET, SO_SNDTIMEO, &kLongest, sizeof kLongest);
}

int new_socket() {
  const int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (fd < 0) throw Failure("no socket can be made: " + last_error());
  limit_waits(fd);
  return fd;
}

bool connects(int fd, const sockaddr_un& address) {
  return connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
}

bool readable(int fd, int timeout_ms) {
  pollfd wanted{fd, POLLIN, 0};
  return poll(&wanted, 1, timeout_ms) == 1;
}

/// Makes a call on a socket, and makes it again where only a signal has interrupted it.
template <typename Call>
ssize_t uninterrupted(Call call) {
  for (;;)
    if (const ssize_t result = call(); result >= 0 || errno != EINTR) return result;
}

/// Reads up to the end of the line. Returns what has come when the patience ends, so that a peer
/// who sends a byte now and then cannot hold the daemon up.
std::string read_line(int fd) {
  using Clock = std::chrono::steady_clock;
  const auto end = Clock::now() + kPatience;
  const auto left_ms = [&] {
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(end - Clock::now());
    return static_cast<int>(std::max<std::chrono::milliseconds::rep>(0, left.count()));
  };
  std::string line;
  std::array<char, 512> bytes{};
  while (line.find('\n') == std::string::npos && line.size() < 65536) {
    if (!readable(fd, left_ms())) {
      if (left_ms() == 0) break;
      continue;  // A signal has ended the wait.
    }
    const ssize_t count =
        uninterrupted([&] { return recv(fd, bytes.data(), bytes.size(), MSG_DONTWAIT); });
    if (count <= 0) break;
    line.append(bytes.data(), static_cast<std::size_t>(count));
  }
  return line.substr(0, line.find('\n'));
}

/// Gives up on a peer who takes a little now and then.
void write_line(int fd, std::string line) {
  line += '\n';
  const auto end = std::chrono::steady_clock::now() + kPatience;
  std::size_t sent = 0;
  while (sent < line.size() && std::chrono::steady_clock::now() < end) {
    const ssize_t count = uninterrupted(
        [&] { return send(fd, line.data() + sent, line.size() - sent, MSG_NOSIGNAL); });
    if (count <= 0) return;
    sent += static_cast<std::size_t>(count);
  }
}

/// Reads until the peer ends the connection. Returns nothing where it goes silent before.
std::string read_answer(int fd) {
  std::string answer;
  std::array<char, 65536> bytes{};
  for (;;) {
    if (!readable(fd, kPatienceForAnswer_ms)) return {};
    const ssize_t count = uninterrupted([&] { return recv(fd, bytes.data(), bytes.size(), 0); });
    if (count < 0) return {};
    if (count == 0) break;
    answer.append(bytes.data(), static_cast<std::size_t>(count));
  }
  if (answer.empty() || answer.back() != '\n') return {};  // it was broken off
  answer.pop_back();
  return answer;
}

std::string connect_trouble() {
  if (errno == EACCES)
    return last_error() +
           "; its owner and its group may ask: become a member of that group, which "
           "is curlew for the service of the package";
  if (errno == EAGAIN || errno == EINTR) return "it does not answer";
  if (errno == ENOENT || errno == ECONNREFUSED)
    return last_error() + "; is it running, with this path as control in section [daemon]?";
  return last_error();
}

void require_folder(const std::string& path) {
  const std::filesystem::path folder = std::filesystem::absolute(path).parent_path();
  std::error_code none;
  if (!std::filesystem::is_directory(folder, none))
    throw UsageError("the control socket " + path + " cannot be made: the folder " +
                     folder.string() +
                     " does not exist; make it, or set control in section "
                     "[daemon]. systemd makes /run/curlew for the service");
}

}  // namespace

ControlSocket::ControlSocket(const std::string& path) : path_(path) {
  const sockaddr_un address = address_of(path);
  require_folder(path);
  {
    const Descriptor probe(new_socket());
    if (connects(probe.fd(), address))
      throw Failure("another curlew listens at " + path + ", give this one another control socket");
    // A path that is no socket refuses the connection too. It is somebody's file and must stay.
    struct stat left_behind {};
    if (errno == ECONNREFUSED && lstat(path.c_str(), &left_behind) == 0 &&
        S_ISSOCK(left_behind.st_mode))
      unlink(path.c_str());
  }
  listening_ = new_socket();
  const bool bound =
      bind(listening_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  if (!bound || chmod(path.c_str(), 0660) != 0 || listen(listening_, 4) != 0) {
    const std::string reason = last_error();
    close(listening_);
    if (bound) unlink(path.c_str());
    throw Failure("the control socket " + path + " cannot be made: " + reason);
  }
}

ControlSocket::~ControlSocket() {
  close(listening_);
  unlink(path_.c_str());
}

void ControlSocket::serve(int timeout_ms,
                          const std::function<std::string(const std::string&)>& answer) const {
  if (!readable(listening_, timeout_ms)) return;
  const Descriptor peer(accept4(listening_, nullptr, nullptr, SOCK_CLOEXEC));
  if (peer.fd() < 0) {
    // Whoever asks stays in the queue, as where there is no free descriptor.
    poll(nullptr, 0, timeout_ms);
    return;
  }
  limit_waits(peer.fd());
  write_line(peer.fd(), answer(read_line(peer.fd())));
}

std::string ask_daemon(const std::string& path, const std::string& word) {
  const Descriptor peer(new_socket());
  if (!connects(peer.fd(), address_of(path)))
    throw Failure("no curlew listens at " + path + ": " + connect_trouble());
  write_line(peer.fd(), word);
  std::string answer = read_answer(peer.fd());
  if (answer.empty()) throw Failure("the curlew at " + path + " does not answer");
  return answer;
}

}  // namespace curlew
