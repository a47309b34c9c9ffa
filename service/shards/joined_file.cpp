#include "service/shards/joined_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <system_error>

#include "acquisition/fits/hdu_bytes.h"
#include "acquisition/fits/partial_path.h"
#include "core/error.h"

namespace curlew {

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

void JoinedFile::write_at(std::int64_t place, std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    const ssize_t n = pwrite(file_.get(), bytes.data(), bytes.size(), static_cast<off_t>(place));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) fail();
    bytes = bytes.subspan(static_cast<std::size_t>(n));
    place += n;
  }
}

void JoinedFile::write_at(std::int64_t place, const std::string& text) {
  write_at(place, std::as_bytes(std::span(text)));
}

void JoinedFile::append(std::span<const std::byte> bytes) {
  write_at(bytes_, bytes);
  bytes_ += static_cast<std::int64_t>(bytes.size());
}

void JoinedFile::append(const std::string& text) { append(std::as_bytes(std::span(text))); }

void JoinedFile::append_zeros(std::int64_t bytes) {
  bytes_ += bytes;
  if (ftruncate(file_.get(), static_cast<off_t>(bytes_)) != 0) fail();
}

void JoinedFile::end_hdu() { append_zeros(whole_blocks(bytes_) - bytes_); }

void JoinedFile::commit() {
  if (close(file_.release()) != 0) fail();
  std::error_code error;
  std::filesystem::rename(partial_, target_, error);
  if (error) throw Failure(path_ + " cannot be written: " + error.message());
  partial_.clear();
}

}  // namespace curlew
