// ByteReader: a part of a file as bytes, with their digest.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "acquisition/fits/bytes_digest.h"
#include "acquisition/fits/file_descriptor.h"

namespace curlew {

/// Throws Failure for a file that cannot be read.
FileDescriptor open_for_reading(const std::string& path);

/// Reads a part of a file once, from its beginning to its end.
class ByteReader {
 public:
  /// file: an open file, which must stay open. path: what messages call it.
  ByteReader(int file, std::int64_t begin, std::int64_t end, std::string path);

  /// Returns the next bytes, some hundred thousand at most; none at the end. They are valid until
  /// the next call. Throws Failure where the file cannot be read, or is shorter than it was.
  std::span<const std::byte> next_block();
  /// Reads the next bytes. Throws Failure where the part ends before.
  void read(std::span<std::byte> into);
  /// Reads what is left, and returns the digest of the whole part.
  std::uint64_t digest_to_end();

 private:
  void fill();

  int file_;
  std::int64_t at_;  ///< behind what is in the buffer
  std::int64_t end_;
  std::string path_;
  std::vector<std::byte> buffer_;
  std::size_t first_ = 0;     ///< of the bytes in the buffer that were not taken yet
  std::size_t buffered_ = 0;  ///< their number
  BytesDigest digest_;        ///< of all that was in the buffer
};

}  // namespace curlew
