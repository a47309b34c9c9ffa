#include "service/shards/byte_reader.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <system_error>
#include <utility>

#include "acquisition/fits/hdu_bytes.h"
#include "core/as_size.h"
#include "core/error.h"

namespace curlew {
namespace {

/// A block stays in the processor's cache while it is digested and written.
constexpr std::int64_t kBuffer_bytes = 64 * kFitsBlock;
static_assert(kBuffer_bytes % BytesDigest::kStride_bytes == 0);

}  // namespace

FileDescriptor open_for_reading(const std::string& path) {
  FileDescriptor file(open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (!file) throw Failure(path + " cannot be read: " + std::generic_category().message(errno));
  return file;
}

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
  digest_.add(buffer_);
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

std::uint64_t ByteReader::digest_to_end() {
  while (!next_block().empty()) {
  }
  return digest_.value();
}

}  // namespace curlew
