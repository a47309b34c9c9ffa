// GrowingLines appends lines of text to a file, a pipe or standard output for as long as a daemon
// lives.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <string>
#include <string_view>

namespace curlew {

/// These are the settings jsonl_… of section [daemon] in the configuration.
struct JsonLinesOptions {
  int max_mb = 0;       ///< At this size the file is put aside and a new one begun; 0: never.
  double max_s = 0.0;   ///< At this age too; 0: never.
  int keep_files = 10;  ///< So many that were put aside are kept: PATH.1 is the newest.
  int every_nth = 1;    ///< Only every nth frame gets a line.
  bool vortices_only = false;  ///< Only frames with vortices get a line.
  bool zernike = false;        ///< Lines have Zernike coefficients.
};

/// A file never ends in half a line: what a full disk has not taken whole is taken back, and half a
/// line that a killed process left is cut off before the first one is appended. Where the file was
/// moved or removed meanwhile, a new one is begun. After trouble it tries again once a second. A
/// pipe without a reader is such a trouble, and a new reader begins with a whole line. One thread
/// at a time may use it.
class GrowingLines {
 public:
  /// path: a file, a pipe, a device or "-", standard output. Throws Failure if the file or device
  /// cannot be written, or is there and does not hold lines of JSON. A pipe that nobody reads yet
  /// is no error.
  GrowingLines(std::string path, const JsonLinesOptions& options);
  ~GrowingLines();
  GrowingLines(const GrowingLines&) = delete;
  GrowingLines& operator=(const GrowingLines&) = delete;

  /// Writes whole lines. Waits while the reader of a pipe is slow, until give_up(). Returns false
  /// if they could not be written; trouble() then tells why.
  bool write(std::string_view lines);

  /// A pipe or a device, where somebody waits for every line.
  bool is_stream() const { return is_stream_; }
  /// Tells why the last write() failed, as a sentence that names the file.
  const std::string& trouble() const { return trouble_; }
  /// Makes write() wait no longer. Any thread may call it.
  void give_up() noexcept { given_up_ = true; }

 private:
  using Clock = std::chrono::steady_clock;

  bool open();
  bool cut_half_line();
  bool still_there() const;
  void put_aside() const;
  bool write_file(std::string_view lines);
  bool fail(int error);
  bool fail(const std::string& why);

  std::string path_;
  JsonLinesOptions options_;
  bool is_stream_ = false;
  int fd_ = -1;
  std::int64_t bytes_ = 0;  ///< the size of the file
  Clock::time_point opened_;
  Clock::time_point next_attempt_;
  std::string trouble_;
  std::atomic<bool> given_up_{false};
};

}  // namespace curlew
