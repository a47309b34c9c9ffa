// This runs code in a child process without the rights of root, for what an ordinary user meets.
#pragma once

#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <exception>
#include <string>

namespace curlew {

inline constexpr const char* kNoSuchLimits = "no such limits";

/// Runs body() in a child process, as nobody if this process is root, and with these hard limits.
/// Returns what body() returned, kNoSuchLimits if they cannot be set, and "child died" if it died.
template <typename Body>
std::string as_ordinary_user(rlim_t rtprio, rlim_t memlock_bytes, Body&& body) {
  constexpr uid_t kNobody = 65534;
  int ends[2];
  if (pipe(ends) != 0) return "no pipe";
  std::fflush(nullptr);
  const pid_t child = fork();
  if (child == 0) {
    close(ends[0]);
    const rlimit priority{rtprio, rtprio};
    const rlimit memory{memlock_bytes, memlock_bytes};
    std::string text;
    if (setrlimit(RLIMIT_RTPRIO, &priority) != 0 || setrlimit(RLIMIT_MEMLOCK, &memory) != 0 ||
        (geteuid() == 0 && (setgid(kNobody) != 0 || setuid(kNobody) != 0))) {
      text = kNoSuchLimits;
    } else {
      try {
        text = body();
      } catch (const std::exception& error) {
        text = std::string("threw ").append(error.what());
      }
    }
    const char* rest = text.data();
    for (std::size_t left = text.size(); left > 0;) {
      const ssize_t sent = write(ends[1], rest, left);
      if (sent <= 0) _exit(1);
      rest += sent;
      left -= static_cast<std::size_t>(sent);
    }
    _exit(0);
  }
  close(ends[1]);
  std::string text;
  char buffer[4096];
  for (ssize_t got = 0; (got = read(ends[0], buffer, sizeof buffer)) > 0;)
    text.append(buffer, static_cast<std::size_t>(got));
  close(ends[0]);
  int status = 0;
  waitpid(child, &status, 0);
  return WIFEXITED(status) && WEXITSTATUS(status) == 0 ? text : "child died";
}

}  // namespace curlew
