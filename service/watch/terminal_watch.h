// A TerminalWatch shows the daemon's frames on the terminal.
#pragma once

#include <string>
#include <vector>

#include "service/page/frame_tap.h"

namespace curlew {

/// While it lives it has the terminal for itself; what was there comes back at its end.
class TerminalWatch {
 public:
  /// Throws UsageError if standard output is no terminal.
  TerminalWatch();
  ~TerminalWatch();
  TerminalWatch(const TerminalWatch&) = delete;
  TerminalWatch& operator=(const TerminalWatch&) = delete;

  /// The publisher's thread passes the frames here.
  FrameTap& tap() { return tap_; }

  /// Draws the newest frame if one has come since the last call, and at most two lines below it.
  /// Always the same thread calls it.
  void draw(const std::vector<std::string>& lines);

 private:
  FrameTap tap_;
  std::string picture_;  ///< the last one
};

}  // namespace curlew
