// LiveFeed gives the newest frame that a camera has delivered.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <limits>

#include "core/frame_exchange.h"
#include "service/feed.h"

namespace curlew {

/// The feed and the thread that watches it share this.
struct FeedControl {
  std::atomic<bool> stop{false};
  /// Grows while the feed runs, also if no frames come.
  std::atomic<std::int64_t> signs_of_life{0};
};

/// Takes frames from the exchange until the exchange is closed, a limit is reached, a stop is asked
/// for, or no frame has come for too long.
class LiveFeed final : public Feed {
 public:
  struct Limits {
    std::int64_t first_index = 0;  ///< frame_index of the first frame
    std::int64_t end_index = std::numeric_limits<std::int64_t>::max();
    std::chrono::steady_clock::time_point until = std::chrono::steady_clock::time_point::max();
    double timeout_s = 0.0;  ///< the longest wait for a frame; 0: for ever
  };
  enum class End {
    kStopped,   ///< `stop` was set
    kLimit,     ///< the frames or the time that were asked for are over
    kClosed,    ///< the camera closed the exchange
    kTimedOut,  ///< no frame came for timeout_s
  };

  LiveFeed(FrameExchange& exchange, const Limits& limits, FeedControl& control);

  bool fill(FrameSlot& slot) override;
  void release(FrameSlot& slot) noexcept override;

  /// Returns why the feed ended. It is known once the run is over.
  End end() const { return end_; }
  /// Returns the index that the next frame would have had.
  std::int64_t next_index() const { return next_index_; }

 private:
  bool finish(End end) noexcept {
    end_ = end;
    return false;
  }

  FrameExchange& exchange_;
  Limits limits_;
  FeedControl& control_;
  std::int64_t next_index_;
  End end_ = End::kStopped;
};

}  // namespace curlew
