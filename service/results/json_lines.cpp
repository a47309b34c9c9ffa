#include "service/results/json_lines.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <string_view>
#include <system_error>
#include <utility>

#include "acquisition/fits/partial_path.h"
#include "core/error.h"
#include "service/program/interrupt.h"
#include "service/program/outputs.h"
#include "service/program/stream_writing.h"
#include "service/results/json_line.h"

namespace curlew {
namespace {

constexpr std::size_t kLineBufferBytes = 1 << 16;

}  // namespace

JsonLines::JsonLines(const std::string& path) : path_(path) {
  if (is_standard_output(path)) {
    fd_ = take_standard_output();
  } else if (is_stream(path)) {
    fd_ = open_stream(path, interrupted);
  } else {
    path_ = replaceable_target(path);
    partial_ = partial_path(path_);
    fd_ = open(partial_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  }
  if (fd_ < 0) refuse(errno);
}

JsonLines::~JsonLines() {
  if (fd_ >= 0) close(fd_);
  std::error_code none;
  if (!partial_.empty()) std::filesystem::remove(partial_, none);
}

void JsonLines::add(const FrameResult& result, const AirReport* air) {
  append_json_line(result, buffer_, air);
  if (partial_.empty() || buffer_.size() >= kLineBufferBytes) write_out();
}

void JsonLines::commit() {
  write_out();
  if (close(std::exchange(fd_, -1)) != 0) refuse(errno);
  if (partial_.empty()) return;
  std::error_code error;
  std::filesystem::rename(partial_, path_, error);
  if (error) throw Failure(path_ + " cannot be written: " + error.message());
  partial_.clear();
}

void JsonLines::write_out() {
  std::string_view text = buffer_;
  if (partial_.empty()) {
    if (const int error = write_stream(fd_, text, interrupted); error != 0) refuse(error);
  }
  while (!text.empty()) {
    const ssize_t count = write(fd_, text.data(), text.size());
    if (count < 0 && errno != EINTR) refuse(errno);
    if (count > 0) text.remove_prefix(static_cast<std::size_t>(count));
  }
  buffer_.clear();
}

void JsonLines::refuse(int error) const {
  throw Failure(path_ + " cannot be written: " + writing_trouble(error));
}

}  // namespace curlew
