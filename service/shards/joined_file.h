// JoinedFile: a FITS file that is put together of bytes of others.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "acquisition/fits/file_descriptor.h"

namespace curlew {

/// Reads a part of a file from its beginning to its end.
class ByteReader {
 public:
  /// file: an open file, which must stay open.
  ByteReader(int file, std::int64_t begin, std::int64_t end, std::string path);

  std::int64_t left() const { return end_ - at_ + static_cast<std::int64_t>(buffered_); }
  /// Returns the next bytes, a million at most; none at the end. They are valid until the next
  /// call. Throws Failure where the file cannot be read, or is shorter than it was.
  std::span<const std::byte> next_block();
  /// Reads the next bytes. Throws Failure where the part ends before.
  void read(std::span<std::byte> into);

 private:
  void fill();

  int file_;
  std::int64_t at_;  ///< behind what is in the buffer
  std::int64_t end_;
  std::string path_;
  std::vector<std::byte> buffer_;
  std::size_t first_ = 0;     ///< of the bytes in the buffer that were not taken yet
  std::size_t buffered_ = 0;  ///< their number
};

/// A file that appears under its name only by commit(); without it nothing is left.
class JoinedFile {
 public:
  /// Throws Failure for a path where no file can be put.
  explicit JoinedFile(const std::string& path);
  JoinedFile(const JoinedFile&) = delete;
  JoinedFile& operator=(const JoinedFile&) = delete;
  ~JoinedFile();

  void append(std::span<const std::byte> bytes);
  void append(const std::string& text);
  /// Fills up with zeros to whole blocks of FITS.
  void end_hdu();
  void commit();

 private:
  [[noreturn]] void fail() const;

  std::string path_;
  std::string target_;
  std::string partial_;
  FileDescriptor file_;
  std::int64_t bytes_ = 0;
};

}  // namespace curlew
