// Preloaded, this makes one call of a program fail: the CURLEW_FAIL_AT-th call (from 1) of
// CURLEW_FAIL_CALL on a file whose path contains CURLEW_FAIL_PATH, or on a socket where that is
// empty. It fails with the error number CURLEW_FAIL_WITH; with 0 a write takes half of its bytes.
// It then makes the file CURLEW_FAIL_MARK. With CURLEW_FAIL_EVERY every so many-th call after it
// fails as well.
#include <dlfcn.h>
#include <fcntl.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>

namespace {

template <typename Function>
Function* next(const char* name) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}

const char* setting(const char* name) {
  const char* text = std::getenv(name);
  return text != nullptr ? text : "";
}

std::string path_of(int fd) {
  std::array<char, 4096> path{};
  const std::string link = "/proc/self/fd/" + std::to_string(fd);
  const ssize_t length = readlink(link.c_str(), path.data(), path.size());
  return {path.data(), static_cast<std::size_t>(length > 0 ? length : 0)};
}

/// Returns whether this call is the one that fails. Sets errno if so.
bool fails(const char* call, const std::string& path) {
  static std::atomic<int> calls{0};
  if (std::strcmp(call, setting("CURLEW_FAIL_CALL")) != 0) return false;
  if (path.find(setting("CURLEW_FAIL_PATH")) == std::string::npos) return false;
  const int after = ++calls - std::atoi(setting("CURLEW_FAIL_AT"));
  const int every = std::atoi(setting("CURLEW_FAIL_EVERY"));
  if (after != 0 && (after < 0 || every == 0 || after % every != 0)) return false;
  const int mark = creat(setting("CURLEW_FAIL_MARK"), 0600);
  next<int(int)>("close")(mark);
  errno = std::atoi(setting("CURLEW_FAIL_WITH"));
  return true;
}

}  // namespace

extern "C" {

int open(const char* path, int flags, ...) {
  std::va_list more;
  va_start(more, flags);
  const mode_t mode = va_arg(more, mode_t);
  va_end(more);
  if (fails("open", path)) return -1;
  return next<int(const char*, int, ...)>("open")(path, flags, mode);
}

ssize_t write(int fd, const void* bytes, std::size_t size) {
  if (fails("write", path_of(fd))) {
    if (errno != 0) return -1;
    size = (size + 1) / 2;
  }
  return next<ssize_t(int, const void*, std::size_t)>("write")(fd, bytes, size);
}

ssize_t pwrite(int fd, const void* bytes, std::size_t size, off_t offset) {
  if (fails("pwrite", path_of(fd))) {
    if (errno != 0) return -1;
    size = (size + 1) / 2;
  }
  return next<ssize_t(int, const void*, std::size_t, off_t)>("pwrite")(fd, bytes, size, offset);
}

int ftruncate(int fd, off_t size) noexcept {
  if (fails("ftruncate", path_of(fd))) return -1;
  return next<int(int, off_t)>("ftruncate")(fd, size);
}

int posix_fallocate(int fd, off_t offset, off_t size) {
  if (fails("posix_fallocate", path_of(fd))) return errno;
  return next<int(int, off_t, off_t)>("posix_fallocate")(fd, offset, size);
}

int rename(const char* from, const char* to) noexcept {
  if (fails("rename", to)) return -1;
  return next<int(const char*, const char*)>("rename")(from, to);
}

int renameat2(int from_fd, const char* from, int to_fd, const char* to, unsigned flags) noexcept {
  if (fails("renameat2", to)) return -1;
  return next<int(int, const char*, int, const char*, unsigned)>("renameat2")(from_fd, from, to_fd,
                                                                              to, flags);
}

int close(int fd) {
  const bool failing = fails("close", path_of(fd));
  const int error = errno;
  const int result = next<int(int)>("close")(fd);
  if (!failing) return result;
  errno = error;
  return -1;
}

// These are what cfitsio calls.
FILE* fopen(const char* path, const char* mode) {
  if (fails("fopen", path)) return nullptr;
  return next<FILE*(const char*, const char*)>("fopen")(path, mode);
}

FILE* fopen64(const char* path, const char* mode) {
  if (fails("fopen", path)) return nullptr;
  return next<FILE*(const char*, const char*)>("fopen64")(path, mode);
}

std::size_t fwrite(const void* bytes, std::size_t size, std::size_t count, FILE* file) {
  if (fails("fwrite", path_of(fileno(file)))) return 0;
  return next<std::size_t(const void*, std::size_t, std::size_t, FILE*)>("fwrite")(bytes, size,
                                                                                   count, file);
}

int fclose(FILE* file) {
  const bool failing = fails("fclose", path_of(fileno(file)));
  const int error = errno;
  const int result = next<int(FILE*)>("fclose")(file);
  if (!failing) return result;
  errno = error;
  return EOF;
}

int socket(int domain, int type, int protocol) noexcept {
  if (fails("socket", "")) return -1;
  return next<int(int, int, int)>("socket")(domain, type, protocol);
}

int bind(int fd, const sockaddr* address, socklen_t length) noexcept {
  if (fails("bind", "")) return -1;
  return next<int(int, const sockaddr*, socklen_t)>("bind")(fd, address, length);
}

int listen(int fd, int backlog) noexcept {
  if (fails("listen", "")) return -1;
  return next<int(int, int)>("listen")(fd, backlog);
}

int accept4(int fd, sockaddr* address, socklen_t* length, int flags) {
  if (fails("accept4", "")) return -1;
  return next<int(int, sockaddr*, socklen_t*, int)>("accept4")(fd, address, length, flags);
}

int connect(int fd, const sockaddr* address, socklen_t length) {
  if (fails("connect", "")) return -1;
  return next<int(int, const sockaddr*, socklen_t)>("connect")(fd, address, length);
}

int setsockopt(int fd, int level, int name, const void* value, socklen_t length) noexcept {
  if (fails("setsockopt", "")) return -1;
  return next<int(int, int, int, const void*, socklen_t)>("setsockopt")(fd, level, name, value,
                                                                        length);
}

ssize_t recv(int fd, void* bytes, std::size_t size, int flags) {
  if (fails("recv", "")) return -1;
  return next<ssize_t(int, void*, std::size_t, int)>("recv")(fd, bytes, size, flags);
}

ssize_t recvmsg(int fd, msghdr* message, int flags) {
  if (fails("recvmsg", "")) return -1;
  return next<ssize_t(int, msghdr*, int)>("recvmsg")(fd, message, flags);
}

ssize_t send(int fd, const void* bytes, std::size_t size, int flags) {
  if (fails("send", "")) {
    if (errno != 0) return -1;
    size = (size + 1) / 2;
  }
  return next<ssize_t(int, const void*, std::size_t, int)>("send")(fd, bytes, size, flags);
}

ssize_t sendmsg(int fd, const msghdr* message, int flags) {
  if (fails("sendmsg", "")) return -1;
  return next<ssize_t(int, const msghdr*, int)>("sendmsg")(fd, message, flags);
}

int poll(pollfd* polled, nfds_t count, int timeout_ms) {
  if (fails("poll", "")) return -1;
  return next<int(pollfd*, nfds_t, int)>("poll")(polled, count, timeout_ms);
}

}  // extern "C"
