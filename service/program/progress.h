// Progress says during long work how far it is: by a line on the terminal, or by lines of JSON for
// the program that waits for it.
#pragma once

#include <unistd.h>

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <string>
#include <utility>

namespace curlew {

enum class ProgressStyle {
  kTerminal,  ///< one line that changes; nothing where standard error is no terminal
  /// {"progress": "replay", "done": 120, "total": 1000, "seconds": 3.2} on standard error, once a
  /// second and at the end; "total" is null where it is not known
  kJson,
};

class Progress {
 public:
  /// Sets the style of all work that begins from now on.
  static void set_style(ProgressStyle style) { style_ = style; }

  /// total: how many steps there will be; −1: unknown. `what` is free of quotes and backslashes.
  Progress(std::string what, std::int64_t total)
      : what_(std::move(what)), total_(total), json_(style_ == ProgressStyle::kJson) {}
  ~Progress() {
    if (json_) print_json(std::chrono::steady_clock::now());
    if (shown_) std::fprintf(stderr, "\r\033[K");
  }
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  void step() {
    ++done_;
    if (!json_ && !terminal_) return;
    const auto now = std::chrono::steady_clock::now();
    if (now < next_) return;
    next_ = now + (json_ ? std::chrono::milliseconds(1000) : std::chrono::milliseconds(100));
    if (json_) return print_json(now);
    shown_ = true;
    if (total_ > 0)
      std::fprintf(stderr, "\r\033[K%s %lld of %lld (%lld %%)", what_.c_str(),
                   static_cast<long long>(done_), static_cast<long long>(total_),
                   static_cast<long long>(100 * done_ / total_));
    else
      std::fprintf(stderr, "\r\033[K%s %lld", what_.c_str(), static_cast<long long>(done_));
  }

 private:
  using Time = std::chrono::steady_clock::time_point;

  void print_json(Time now) const {
    const std::string total = total_ < 0 ? "null" : std::to_string(total_);
    std::fprintf(stderr,
                 "{\"progress\": \"%s\", \"done\": %lld, \"total\": %s, \"seconds\": %.3f}\n",
                 what_.c_str(), static_cast<long long>(done_), total.c_str(),
                 std::chrono::duration<double>(now - start_).count());
  }

  inline static ProgressStyle style_ = ProgressStyle::kTerminal;

  std::string what_;
  std::int64_t total_;
  std::int64_t done_ = 0;
  bool json_;
  bool terminal_ = isatty(STDERR_FILENO) == 1;
  bool shown_ = false;
  Time start_ = std::chrono::steady_clock::now();
  Time next_{};
};

}  // namespace curlew
