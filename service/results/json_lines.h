// JsonLines: one JSON object a frame, for programs that follow along.
#pragma once

#include <atomic>
#include <string>

#include "service/results/frame_result.h"

namespace curlew {

enum class JsonLinesFile {
  kComplete,  ///< appears under its name by commit() and not before
  kGrowing,   ///< is appended to in place, for those who follow along
};

/// The format of DESIGN.md. A pipe or device is written to as the frames come, whatever is asked
/// for. Failure names the file; also where a growing file is a pipe that nobody reads.
class JsonLines {
 public:
  explicit JsonLines(const std::string& path, JsonLinesFile file = JsonLinesFile::kComplete);
  ~JsonLines();
  JsonLines(const JsonLines&) = delete;
  JsonLines& operator=(const JsonLines&) = delete;

  void add(const FrameResult& result);
  /// Writes out what is still in memory.
  void flush();
  void commit();

  /// Any thread: whoever waits for a reader that does not read shall stop waiting, with a Failure.
  void give_up() noexcept { given_up_ = true; }

 private:
  void write_out();
  [[noreturn]] void refuse(int error) const;

  std::string path_;
  std::string writing_path_;  ///< what is really open
  bool in_place_ = false;     ///< growing, a pipe or a device
  bool stream_only_ = false;  ///< a pipe or a device: somebody waits for every line
  int fd_ = -1;
  std::string buffer_;  ///< lines not written yet
  std::atomic<bool> given_up_{false};
};

}  // namespace curlew
