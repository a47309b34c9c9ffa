// The time of a frame, for whatever follows things from frame to frame.
#pragma once

#include "core/frame.h"

namespace curlew {

/// Returns the time in s by the camera's clock, else the time of receipt, else one second a frame.
inline double time_s(const FrameHeader& header) noexcept {
  if (header.camera_ns != 0) return 1e-9 * static_cast<double>(header.camera_ns);
  if (header.received_ns != 0) return 1e-9 * static_cast<double>(header.received_ns);
  return static_cast<double>(header.sequence);
}

/// Says whether time_s() is in seconds, and not in frames.
inline bool has_clock(const FrameHeader& header) noexcept {
  return header.camera_ns != 0 || header.received_ns != 0;
}

}  // namespace curlew
