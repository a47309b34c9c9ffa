#include "service/program/stream_writing.h"

#include <fcntl.h>
#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <climits>
#include <system_error>

namespace curlew {
namespace {

constexpr int kLookUpMs = 100;
constexpr int kMostInterruptions = 20;  // in a row, after which it is asked whether to stop

}  // namespace

int open_stream(const std::string& path, const std::function<bool()>& stop) {
  while (true) {
    const int fd = open(path.c_str(), O_WRONLY | O_NONBLOCK | O_NOCTTY | O_CLOEXEC);
    if (fd >= 0 || (errno != ENXIO && errno != EINTR)) return fd;
    errno = ENXIO;
    if (stop()) return -1;
    poll(nullptr, 0, kLookUpMs);
  }
}

int write_stream(int fd, std::string_view& text, const std::function<bool()>& stop) {
  int interruptions = 0;
  while (!text.empty()) {
    // Once poll() says so, a pipe takes this many bytes, even where the descriptor is one that
    // blocks.
    pollfd room{fd, POLLOUT, 0};
    const int ready = poll(&room, 1, kLookUpMs);
    // An interruption says nothing of the reader.
    if (ready < 0 && errno == EINTR && ++interruptions < kMostInterruptions) continue;
    if (ready <= 0) {
      if (stop()) return EAGAIN;
      continue;
    }
    const ssize_t count = write(fd, text.data(), std::min<std::size_t>(text.size(), PIPE_BUF));
    if (count > 0) {
      text.remove_prefix(static_cast<std::size_t>(count));
      interruptions = 0;
    } else if (count < 0 && errno == EINTR && ++interruptions < kMostInterruptions) {
      continue;
    } else if (count < 0 && errno != EINTR && errno != EAGAIN) {
      return errno;
    } else if (stop()) {
      return EAGAIN;
    }
  }
  return 0;
}

std::string writing_trouble(int error) {
  if (error == EAGAIN) return "its reader does not read";
  if (error == ENXIO) return "nobody reads this pipe";
  if (error == EPIPE) return "its reader is gone";
  return std::generic_category().message(error) + "; is the disk full or the folder missing?";
}

}  // namespace curlew
