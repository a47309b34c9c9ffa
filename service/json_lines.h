// JsonLines: one JSON object a frame, for programs that follow along.
#pragma once

#include <cstdint>
#include <fstream>
#include <string>

#include "service/stages.h"

namespace curlew {

/// The format of DESIGN.md. A regular file appears under its name by commit() and not before; a
/// pipe or device is written to as the frames come. Failure names the file.
class JsonLines {
 public:
  explicit JsonLines(const std::string& path);
  ~JsonLines();
  JsonLines(const JsonLines&) = delete;
  JsonLines& operator=(const JsonLines&) = delete;

  /// dropped: frames lost so far.
  void add(const FrameSlot& slot, std::int64_t dropped);
  void commit();

 private:
  void check();

  std::string path_;
  std::string writing_path_;  ///< what is really open
  bool in_place_ = false;     ///< a pipe or a device
  std::ofstream stream_;
};

}  // namespace curlew
