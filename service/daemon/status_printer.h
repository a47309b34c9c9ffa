// StatusPrinter shows the daemon's status: a line a second on a terminal, otherwise a line every
// ten seconds in the log.
#pragma once

#include <string>

#include "service/daemon/daemon_status.h"

namespace curlew {

/// Returns "streaming  1000.0 frames/s  p50 83 p99 120 max 300 µs  vortices 3", and where frames
/// were lost also how many, by their causes.
std::string status_line(const StatusSnapshot& status);

/// Returns the line for the log, in the form key=value.
std::string status_fields(const StatusSnapshot& status);

/// Returns the answer to `curlew control status`: one JSON object in one line.
std::string status_json(const StatusSnapshot& status);

class StatusPrinter {
 public:
  StatusPrinter();
  /// Call it once a second.
  void add(const StatusSnapshot& status);

 private:
  bool terminal_;
  int seconds_ = 0;
};

}  // namespace curlew
