#include "service/shards/joined_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <system_error>
#include <utility>

#include "acquisition/fits/hdu_bytes.h"
#include "acquisition/fits/partial_path.h"
#include "core/as_size.h"
#include "core/error.h"

namespace curlew {
namespace {

constexpr std::int64_t kBuffer_bytes = 1 << 20;

}  // namespace

ByteReader::ByteReader(int file, std::int64_t begin, std::int64_t end, std::string path)
    : file_(file), at_(begin), end_(std::max(begin, end)), path_(std::move(path)) {}

void ByteReader::fill() {
  buffer_.resize(as_size(std::min(kBuffer_bytes, end_ - at_)));
  first_ = 0;
  buffered_ = 0;
  while (buffered_ < buffer_.size()) {
    const ssize_t n = pread(file_, buffer_.data() + buffered_, buffer_.size() - buffered_,
                            static_cast<off_t>(at_));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) throw Failure(path_ + " cannot be read: " + std::generic_category().message(errno));
    if (n == 0) throw Failure(path_ + " became shorter while it was read");
    buffered_ += static_cast<std::size_t>(n);
    at_ += n;
  }
}

std::span<const std::byte> ByteReader::next_block() {
  if (buffered_ == 0) fill();
  const std::span<const std::byte> block(buffer_.data() + first_, buffered_);
  first_ += buffered_;
  buffered_ = 0;
  return block;
}

void ByteReader::read(std::span<std::byte> into) {
  while (!into.empty()) {
    if (buffered_ == 0) fill();
    if (buffered_ == 0) throw Failure(path_ + " is damaged: a table ends too early; do it again");
    const std::size_t n = std::min(buffered_, into.size());
    std::memcpy(into.data(), buffer_.data() + first_, n);
    first_ += n;
    buffered_ -= n;
    into = into.subspan(n);
  }
}

JoinedFile::JoinedFile(const std::string& path)
    : path_(path), target_(replaceable_target(path)), partial_(partial_path(target_)) {
  file_ = FileDescriptor(open(partial_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666));
  if (!file_) fail();
}

JoinedFile::~JoinedFile() {
  std::error_code ignored;
  if (!partial_.empty()) std::filesystem::remove(partial_, ignored);
}

void JoinedFile::fail() const {
  throw Failure(path_ + " cannot be written: " + std::generic_category().message(errno));
}

void JoinedFile::append(std::span<const std::byte> bytes) {
  bytes_ += static_cast<std::int64_t>(bytes.size());
  while (!bytes.empty()) {
    const ssize_t n = write(file_.get(), bytes.data(), bytes.size());
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) fail();
    bytes = bytes.subspan(static_cast<std::size_t>(n));
  }
}

void JoinedFile::append(const std::string& text) { append(std::as_bytes(std::span(text))); }

void JoinedFile::end_hdu() {
  append(std::vector<std::byte>(as_size(whole_blocks(bytes_) - bytes_)));
}

void JoinedFile::commit() {
  if (close(file_.release()) != 0) fail();
  std::error_code error;
  std::filesystem::rename(partial_, target_, error);
  if (error) throw Failure(path_ + " cannot be written: " + error.message());
  partial_.clear();
}

}  // namespace curlew
