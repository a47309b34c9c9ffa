#include "service/results/growing_lines.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <system_error>
#include <utility>

#include "acquisition/fits/partial_path.h"
#include "core/as_size.h"
#include "core/error.h"
#include "service/program/outputs.h"
#include "service/program/stream_writing.h"

namespace curlew {
namespace {

constexpr std::chrono::seconds kAttemptInterval{1};
constexpr std::int64_t kMegabyte = 1'000'000;
// A line of the most vortices that a frame can have is shorter.
constexpr std::int64_t kLongestLine = std::int64_t{1} << 30;

}  // namespace

GrowingLines::GrowingLines(std::string path, const JsonLinesOptions& options)
    : path_(std::move(path)), options_(options) {
  const bool is_stdout = is_standard_output(path_);
  is_stream_ = is_stdout || curlew::is_stream(path_);
  if (is_stdout) {
    fd_ = take_standard_output();
    return;
  }
  if (!is_stream_) path_ = replaceable_target(path_);
  if (!open() && !is_stream_) throw Failure(trouble_);
}

GrowingLines::~GrowingLines() {
  if (fd_ >= 0) close(fd_);
}

bool GrowingLines::write(std::string_view lines) {
  if (fd_ >= 0 && !is_stream_) {
    const std::chrono::duration<double> age = Clock::now() - opened_;
    const bool is_full = (options_.max_mb > 0 && bytes_ >= options_.max_mb * kMegabyte) ||
                         (options_.max_s > 0.0 && age.count() >= options_.max_s);
    const bool is_there = still_there();
    if (is_there && is_full) put_aside();
    if (is_full || !is_there) {
      close(std::exchange(fd_, -1));
      next_attempt_ = {};  // It is no trouble that would have to be waited for.
    }
  }
  if (fd_ < 0 && (Clock::now() < next_attempt_ || !open())) return false;
  if (!is_stream_) return write_file(lines);
  const int error = write_stream(fd_, lines, [this] { return given_up_.load(); });
  return error == 0 || fail(error);
}

/// Opens the file or the stream. A file is begun where there is none.
bool GrowingLines::open() {
  next_attempt_ = Clock::now() + kAttemptInterval;
  opened_ = Clock::now();
  if (is_standard_output(path_)) return fail("standard output is closed");
  fd_ = is_stream_ ? open_stream(path_, [] { return true; })
                   : ::open(path_.c_str(), O_RDWR | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
  if (fd_ < 0) return fail(errno);
  return is_stream_ || cut_half_line();
}

/// Cuts off what follows the last newline, and finds out the size.
bool GrowingLines::cut_half_line() {
  struct stat is {};
  if (fstat(fd_, &is) != 0) return fail(errno);
  bytes_ = is.st_size;
  if (bytes_ == 0) return true;
  char character = 0;
  if (pread(fd_, &character, 1, 0) != 1) return fail(errno);
  if (!S_ISREG(is.st_mode) || character != '{')
    return fail("it holds something else than JSON lines");
  const std::int64_t lowest = std::max<std::int64_t>(0, bytes_ - kLongestLine);
  std::int64_t end = bytes_;
  std::string block;
  while (end > lowest) {
    block.resize(as_size(std::min<std::int64_t>(end - lowest, 1 << 16)));
    const auto begin = end - static_cast<std::int64_t>(block.size());
    if (pread(fd_, block.data(), block.size(), begin) != static_cast<ssize_t>(block.size()))
      return fail(errno);
    const std::size_t newline = block.rfind('\n');
    end = newline == std::string::npos ? begin : begin + static_cast<std::int64_t>(newline) + 1;
    if (newline != std::string::npos) break;
  }
  if (end != bytes_ && ftruncate(fd_, end) != 0) return fail(errno);
  bytes_ = end;
  return true;
}

/// Says whether the open file still has its name.
bool GrowingLines::still_there() const {
  struct stat named {};
  struct stat ours {};
  return stat(path_.c_str(), &named) == 0 && fstat(fd_, &ours) == 0 &&
         named.st_dev == ours.st_dev && named.st_ino == ours.st_ino;
}

/// Gives the file the name PATH.1, and those that were put aside before the next number each. The
/// oldest is replaced.
void GrowingLines::put_aside() const {
  namespace fs = std::filesystem;
  const auto aside = [&](int n) { return n == 0 ? path_ : path_ + "." + std::to_string(n); };
  for (int n = options_.keep_files; n > 0; --n) {
    std::error_code none;
    const fs::file_status what = fs::symlink_status(aside(n), none);
    if (!fs::exists(what) || fs::is_regular_file(what)) fs::rename(aside(n - 1), aside(n), none);
  }
  std::error_code none;
  if (options_.keep_files == 0) fs::remove(path_, none);
}

bool GrowingLines::write_file(std::string_view lines) {
  const std::int64_t end = bytes_;
  while (!lines.empty()) {
    const ssize_t count = ::write(fd_, lines.data(), lines.size());
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) {
      const int error = count < 0 ? errno : ENOSPC;
      // If this fails as well, the next attempt to open the file cuts the half line off.
      [[maybe_unused]] const int result = ftruncate(fd_, end);
      bytes_ = end;
      return fail(error);
    }
    lines.remove_prefix(static_cast<std::size_t>(count));
    bytes_ += count;
  }
  return true;
}

bool GrowingLines::fail(int error) { return fail(writing_trouble(error)); }

bool GrowingLines::fail(const std::string& why) {
  if (fd_ >= 0) close(std::exchange(fd_, -1));
  trouble_ = path_ + " cannot be written: " + why;
  return false;
}

}  // namespace curlew
