// Feed: where the pipeline's frames come from. A recording waits for the pipeline; a camera
// (service/live_feed.h) does not.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <vector>

#include "acquisition/frame_source.h"
#include "service/stages.h"

namespace curlew {

class Feed {
 public:
  virtual ~Feed() = default;

  /// Waits for the next frame, lends it to the slot and sets its index. Returns false at the end.
  virtual bool fill(FrameSlot& slot) = 0;

  /// Takes the slot's frame back, which is published and no longer needed. In a team fill() and
  /// release() are called from changing threads, each from one at a time.
  virtual void release(FrameSlot& slot) noexcept = 0;
};

struct RunOptions {
  /// Frames are delivered no faster than this; 0: as fast as they can be taken.
  double pace_hz = 0.0;
  /// The feed stops after so many frames; −1: at the end of the source.
  std::int64_t max_frames = -1;
  /// The index of the first frame that the source delivers.
  std::int64_t first_frame = 0;
};

/// Delivers every frame of a source and drops none. It also ends at SIGINT and SIGTERM.
class RecordedFeed final : public Feed {
 public:
  RecordedFeed(FrameSource& source, const RunOptions& options);

  bool fill(FrameSlot& slot) override;
  void release(FrameSlot& slot) noexcept override;

 private:
  FrameSource& source_;
  RunOptions options_;
  std::vector<std::unique_ptr<FrameBuffer>> buffers_;  ///< one for each slot
  std::chrono::steady_clock::time_point next_;
  std::int64_t delivered_ = 0;
};

}  // namespace curlew
