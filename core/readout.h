// Rows of a frame that is still being read out, on their way from the camera's thread to the
// pipeline's.
#pragma once

#include <atomic>

#include "core/frame.h"

namespace curlew {

/// FrameBuffer::rows_ready of a frame that broke off before its last row.
inline constexpr int kReadoutBrokeOff = -1;

/// For the camera: says that the first `rows` rows have arrived. With the last one the header must
/// be complete.
inline void announce_rows(FrameBuffer& frame, int rows) noexcept {
  frame.rows_ready.store(rows, std::memory_order_release);
  frame.rows_ready.notify_one();
}

/// For the camera: says that no more rows will come. Whoever works on the frame gives it back, and
/// it has no results.
inline void break_off(FrameBuffer& frame) noexcept { announce_rows(frame, kReadoutBrokeOff); }

/// For the pipeline: says whether the frame was handed on before its last row.
inline bool is_arriving(const FrameBuffer& frame) noexcept {
  const int ready = frame.rows_ready.load(std::memory_order_acquire);
  return ready == kReadoutBrokeOff || (ready > 0 && ready < frame.format().rows);
}

/// For the pipeline: waits until more than `known` rows are there and returns how many, or
/// kReadoutBrokeOff. It spins for a bounded time and then parks. The camera ends every readout by
/// its last row or by break_off().
inline int wait_for_rows(const FrameBuffer& frame, int known) noexcept {
  constexpr int kSpins = 2000;  // about 10 µs
  for (int i = 0; i < kSpins; ++i) {
    const int ready = frame.rows_ready.load(std::memory_order_acquire);
    if (ready != known) return ready;
  }
  frame.rows_ready.wait(known, std::memory_order_acquire);
  return frame.rows_ready.load(std::memory_order_acquire);
}

}  // namespace curlew
