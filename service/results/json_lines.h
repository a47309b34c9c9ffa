// JsonLines writes a recording's results as JSON lines, which are complete in the end.
#pragma once

#include <string>

#include "service/air/air_meter.h"
#include "service/results/frame_result.h"

namespace curlew {

/// Writes the format of docs/files.md. A file appears under its name at commit() and not before. A
/// pipe, a device or "-", standard output, gets each line at once; what the program prints goes to
/// standard error then. Throws Failure, which names the file, if it cannot be written, and if
/// SIGINT or SIGTERM comes while it waits for a pipe's reader.
class JsonLines {
 public:
  explicit JsonLines(const std::string& path);
  ~JsonLines();
  JsonLines(const JsonLines&) = delete;
  JsonLines& operator=(const JsonLines&) = delete;

  /// air: as in append_json_line().
  void add(const FrameResult& result, const AirReport* air = nullptr);
  void commit();

 private:
  void write_out();
  [[noreturn]] void refuse(int error) const;

  std::string path_;
  std::string partial_;  ///< the file that is really open; empty for a stream
  int fd_ = -1;
  std::string buffer_;  ///< lines that are not written yet
};

}  // namespace curlew
