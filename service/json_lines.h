// JsonLines: one JSON object a frame, for programs that follow along.
#pragma once

#include <cstdint>
#include <fstream>
#include <string>

#include "service/frame_result.h"

namespace curlew {

enum class JsonLinesFile {
  kComplete,  ///< appears under its name by commit() and not before
  kGrowing,   ///< is appended to in place, for those who follow along
};

/// The format of DESIGN.md. A pipe or device is written to as the frames come, whatever is asked
/// for. Failure names the file.
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

 private:
  void check();

  std::string path_;
  std::string writing_path_;  ///< what is really open
  bool in_place_ = false;     ///< growing, a pipe or a device
  bool stream_only_ = false;  ///< a pipe or a device: somebody waits for every line
  std::ofstream stream_;
};

}  // namespace curlew
