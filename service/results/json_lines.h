// JsonLines writes one JSON object a frame, for programs that follow along.
#pragma once

#include <atomic>
#include <string>

#include "service/results/frame_result.h"

namespace curlew {

enum class JsonLinesFile {
  kComplete,  ///< the file appears under its name at commit() and not before
  kGrowing,   ///< lines are appended in place, for programs that follow along
};

/// Writes the format of docs/files.md. A pipe or a device gets each line at once, whichever
/// JsonLinesFile is asked for. Throws Failure, which names the file, if it cannot be written, or if
/// a growing file is a pipe that nobody reads.
class JsonLines {
 public:
  explicit JsonLines(const std::string& path, JsonLinesFile file = JsonLinesFile::kComplete);
  ~JsonLines();
  JsonLines(const JsonLines&) = delete;
  JsonLines& operator=(const JsonLines&) = delete;

  void add(const FrameResult& result);
  /// Writes out the lines that are still in memory.
  void flush();
  void commit();

  /// Makes a thread that waits for a slow reader stop waiting, with a Failure. Any thread may call
  /// it.
  void give_up() noexcept { given_up_ = true; }

 private:
  void write_out();
  [[noreturn]] void refuse(int error) const;

  std::string path_;
  std::string writing_path_;  ///< the file that is really open
  bool in_place_ = false;     ///< it is a growing file, a pipe or a device
  bool stream_only_ = false;  ///< it is a pipe or a device, where somebody waits for every line
  int fd_ = -1;
  std::string buffer_;  ///< lines that are not written yet
  std::atomic<bool> given_up_{false};
};

}  // namespace curlew
