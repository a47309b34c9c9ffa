#include "acquisition/fits/unpacking_process.h"

#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>

#include <array>
#include <chrono>
#include <csignal>
#include <system_error>
#include <vector>

#include "acquisition/fits/unpacking_protocol.h"
#include "core/error.h"

extern char** environ;  // NOLINT(readability-redundant-declaration): POSIX has it in no header

namespace curlew {
namespace {

// A process that computes is ended by its limit on processor time long before this many times that.
constexpr std::int64_t kPatience = 10;

/// Says what the new process inherits: the file, the socket, default signals, and a process group
/// of its own, so that Ctrl-C ends this process in order and not that one in disorder.
class SpawnSettings {
 public:
  SpawnSettings(int file, int socket) {
    posix_spawn_file_actions_init(&actions_);
    posix_spawn_file_actions_adddup2(&actions_, file, kUnpackedFile);
    posix_spawn_file_actions_adddup2(&actions_, socket, kUnpackSocket);
    posix_spawn_file_actions_addopen(&actions_, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
    posix_spawn_file_actions_addclosefrom_np(&actions_, STDERR_FILENO + 1);
    posix_spawnattr_init(&attributes_);
    sigset_t signals;
    sigemptyset(&signals);
    posix_spawnattr_setsigmask(&attributes_, &signals);
    sigfillset(&signals);
    posix_spawnattr_setsigdefault(&attributes_, &signals);
    posix_spawnattr_setflags(
        &attributes_, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETPGROUP);
  }
  ~SpawnSettings() {
    posix_spawnattr_destroy(&attributes_);
    posix_spawn_file_actions_destroy(&actions_);
  }
  SpawnSettings(const SpawnSettings&) = delete;
  SpawnSettings& operator=(const SpawnSettings&) = delete;

  const posix_spawn_file_actions_t* actions() const { return &actions_; }
  const posix_spawnattr_t* attributes() const { return &attributes_; }

 private:
  posix_spawn_file_actions_t actions_{};
  posix_spawnattr_t attributes_{};
};

// Fills `into` from the socket. Returns false if the other end closes it or says nothing for too
// long.
bool receive(int socket, std::int32_t longest_ms, std::span<std::byte> into) {
  while (!into.empty()) {
    pollfd wait{socket, POLLIN, 0};
    const int ready = poll(&wait, 1, static_cast<int>(kPatience * longest_ms));
    if (ready < 0 && errno == EINTR) continue;
    if (ready <= 0) return false;
    const ssize_t n = recv(socket, into.data(), into.size(), 0);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    into = into.subspan(static_cast<std::size_t>(n));
  }
  return true;
}

}  // namespace

UnpackingProcess::UnpackingProcess(int file) {
  const auto require = [](int error) {
    if (error != 0)
      throw Failure("no process can be started to unpack compressed pixels: " +
                    std::error_code(error, std::generic_category()).message());
  };
  std::array<int, 2> ends{};
  require(socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) == 0 ? 0 : errno);
  socket_ = FileDescriptor(ends[0]);
  const FileDescriptor other(ends[1]);
  const SpawnSettings settings(file, other.get());
  // posix_spawn does not copy the memory of this process, as fork would do.
  std::array<char, 7> name{"curlew"};
  std::array<char, 16> argument{};
  std::char_traits<char>::copy(argument.data(), kUnpackArgument,
                               std::char_traits<char>::length(kUnpackArgument));
  const std::array<char*, 3> arguments{name.data(), argument.data(), nullptr};
  require(posix_spawn(&process_, "/proc/self/exe", settings.actions(), settings.attributes(),
                      arguments.data(), environ));
}

UnpackingProcess::~UnpackingProcess() {
  if (process_ <= 0) return;
  kill(process_, SIGKILL);
  while (waitpid(process_, nullptr, 0) < 0 && errno == EINTR) {
  }
}

UnpackingProcess::Outcome UnpackingProcess::outcome_of_death() {
  // It has ended, or it is stuck and must.
  socket_ = FileDescriptor();
  const auto patience = std::chrono::steady_clock::now() + std::chrono::milliseconds(200);
  int status = 0;
  pid_t ended = 0;
  while ((ended = waitpid(process_, &status, WNOHANG)) == 0 &&
         std::chrono::steady_clock::now() < patience)
    usleep(1000);
  if (ended == 0) return Outcome::kTooLong;
  process_ = -1;
  return ended > 0 && WIFSIGNALED(status) && WTERMSIG(status) == SIGPROF ? Outcome::kTooLong
                                                                         : Outcome::kDamaged;
}

bool UnpackingProcess::ask(const Request& request) {
  return send(socket_.get(), &request, sizeof(request), MSG_NOSIGNAL) ==
         static_cast<ssize_t>(sizeof(request));
}

UnpackingProcess::Outcome UnpackingProcess::receive_answer(const Request& request,
                                                           std::span<std::byte> into) {
  UnpackReply reply{};
  if (!receive(socket_.get(), request.longest_ms, std::as_writable_bytes(std::span(&reply, 1))))
    return outcome_of_death();
  if (reply == UnpackReply::kTooLarge) return Outcome::kTooLarge;
  if (reply != UnpackReply::kElementsFollow) return Outcome::kDamaged;
  return receive(socket_.get(), request.longest_ms, into) ? Outcome::kRead : outcome_of_death();
}

UnpackingProcess::Outcome UnpackingProcess::read(const Request& request,
                                                 std::span<std::byte> into) {
  if (ahead_ && *ahead_ != request) {
    std::vector<std::byte> unwanted(static_cast<std::size_t>(ahead_->bytes));
    const Outcome outcome = receive_answer(*ahead_, unwanted);
    if (outcome != Outcome::kRead) return outcome;
    ahead_.reset();
  }
  const bool asked = ahead_.has_value() || ask(request);
  ahead_.reset();
  if (!asked) return outcome_of_death();
  const Outcome outcome = receive_answer(request, into);
  if (outcome != Outcome::kRead) return outcome;

  Request next = request;
  next.first += request.elements;
  const bool goes_on = last_.hdu == request.hdu && last_.first + last_.elements == request.first;
  last_ = request;
  // If this cannot be sent, the next call finds out why.
  if (goes_on && next.first <= next.in_image - next.elements && ask(next)) ahead_ = next;
  return Outcome::kRead;
}

}  // namespace curlew
