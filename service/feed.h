// Feed: where the pipeline's frames come from. A recording waits for the pipeline, a camera does
// not (service/live_feed.h).
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

  /// Waits for the next frame and lends it to the slot, with its index; false at the end.
  virtual bool fill(FrameSlot& slot) = 0;

  /// The slot's frame is published and no longer needed. Called from the publisher's thread.
  virtual void release(FrameSlot& slot) noexcept = 0;
};

struct RunOptions {
  double pace_hz = 0.0;  ///< deliver frames no faster than this; 0: as fast as they can be taken
  std::int64_t max_frames = -1;  ///< stop after so many; −1: at the source's end
};

/// Every frame of a source, none dropped. Ends at SIGINT and SIGTERM too.
class RecordedFeed final : public Feed {
 public:
  RecordedFeed(FrameSource& source, const RunOptions& options);

  bool fill(FrameSlot& slot) override;
  void release(FrameSlot& slot) noexcept override;

 private:
  FrameSource& source_;
  RunOptions options_;
  std::vector<std::unique_ptr<FrameBuffer>> buffers_;  ///< one a slot
  std::chrono::steady_clock::time_point next_;
  std::int64_t delivered_ = 0;
};

}  // namespace curlew
