// JoinedFile: a FITS file that is put together of bytes of others.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "acquisition/fits/file_descriptor.h"

namespace curlew {

/// A file that appears under its name only by commit(); without it nothing is left.
class JoinedFile {
 public:
  /// Throws Failure for a path where no file can be put.
  explicit JoinedFile(const std::string& path);
  JoinedFile(const JoinedFile&) = delete;
  JoinedFile& operator=(const JoinedFile&) = delete;
  ~JoinedFile();

  std::int64_t bytes() const { return bytes_; }
  void append(std::span<const std::byte> bytes);
  void append(const std::string& text);
  /// Appends so many zeros, which write_at() may replace.
  void append_zeros(std::int64_t bytes);
  /// Threads may write at different places at once, while one of them appends.
  void write_at(std::int64_t place, std::span<const std::byte> bytes);
  void write_at(std::int64_t place, const std::string& text);
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
