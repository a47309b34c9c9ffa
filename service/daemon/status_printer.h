// StatusPrinter: a line a second on a terminal, a line every ten in the log otherwise.
#pragma once

#include <cstdint>
#include <string>

#include "acquisition/camera.h"
#include "service/daemon/live_statistics.h"
#include "service/recorder/recorder.h"

namespace curlew {

/// What there is to say about the daemon's last second.
struct DaemonStatus {
  std::string state;
  double frames_per_s = 0.0;  ///< results
  StatusWindow window;        ///< of the last results
  FrameCounts frames;         ///< since the start
  std::int64_t superseded = 0;
  std::int64_t results = 0;
  RecorderCounts recorder;
  bool recording = false;
};

/// "streaming  1000.0 frames/s  p50 83 p99 120 max 300 µs  vortices 3  lost 0 …": what was lost,
/// by cause, where anything was.
std::string status_line(const DaemonStatus& status);

/// The same as key=value.
std::string status_fields(const DaemonStatus& status);

class StatusPrinter {
 public:
  StatusPrinter();
  void add(const DaemonStatus& status);

 private:
  bool terminal_;
  int seconds_ = 0;
};

}  // namespace curlew
