// StatusPrinter shows the daemon's status: a line a second on a terminal, otherwise a line every
// ten seconds in the log.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "service/daemon/daemon_status.h"

namespace curlew {

/// Returns "streaming  1000.0 frames/s  p50 83 p99 120 max 300 µs  vortices 3", and where frames
/// were lost also how many, by their causes.
std::string status_line(const StatusSnapshot& status);

/// Returns "beam at x 9.50, y 9.48, D4σ 18.40 x 18.32 lenslets (5.52 x 5.50 mm), 3 % at the rim",
/// and where there is a warning also that.
std::string beam_line(const BeamReport& beam);

/// Returns the line for the log, in the form key=value.
std::string status_fields(const StatusSnapshot& status);

/// What the daemon says of itself beside its counts.
struct DaemonFacts {
  std::string config_hash;
  std::string camera;                   ///< as the configuration names it
  std::optional<std::int64_t> free_mb;  ///< room on the recorder's disk, 10⁶ bytes; none: unknown
  std::string calibration;              ///< what became of the last one; empty: none was asked for
};

/// Returns the answer to `curlew control status`: one JSON object in one line (docs/files.md).
std::string status_json(const StatusSnapshot& status, const DaemonFacts& facts);

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
