// AirTable holds the air of a replay, window by window and as a whole.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "service/air/air_meter.h"
#include "service/results/memory_table.h"

namespace curlew {

class AirTable {
 public:
  AirTable(const Plan& plan, const AirOptions& options);

  /// Returns the report of a window that is complete without this frame.
  std::optional<AirReport> add(const FrameSlot& slot);
  /// Returns the table AIR of a results file: a row for each window, the last of
  /// which may be cut off by the recording's end.
  MemoryTable table() const;
  /// Returns the figures of all frames together, for people.
  std::string text() const;

 private:
  AirMeter meter_;
  AirMeter whole_;
  AirSample sample_;
  std::vector<AirReport> windows_;
};

}  // namespace curlew
