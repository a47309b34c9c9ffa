// Progress shows a line on the terminal during long work. It shows nothing without a terminal.
#pragma once

#include <unistd.h>

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <string>
#include <utility>

namespace curlew {

class Progress {
 public:
  /// total: how many steps there will be; −1: unknown.
  Progress(std::string what, std::int64_t total)
      : what_(std::move(what)), total_(total), terminal_(isatty(STDERR_FILENO) == 1) {}
  ~Progress() {
    if (shown_) std::fprintf(stderr, "\r\033[K");
  }
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  void step() {
    ++done_;
    if (!terminal_) return;
    const auto now = std::chrono::steady_clock::now();
    if (now < next_) return;
    next_ = now + std::chrono::milliseconds(100);
    shown_ = true;
    if (total_ > 0)
      std::fprintf(stderr, "\r\033[K%s %lld of %lld (%lld %%)", what_.c_str(),
                   static_cast<long long>(done_), static_cast<long long>(total_),
                   static_cast<long long>(100 * done_ / total_));
    else
      std::fprintf(stderr, "\r\033[K%s %lld", what_.c_str(), static_cast<long long>(done_));
  }

 private:
  std::string what_;
  std::int64_t total_;
  std::int64_t done_ = 0;
  bool terminal_;
  bool shown_ = false;
  std::chrono::steady_clock::time_point next_{};
};

}  // namespace curlew
