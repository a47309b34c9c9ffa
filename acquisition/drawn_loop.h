// A DrawnLoop delivers frames over and over that another source draws once, and begins before all
// are drawn.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "acquisition/frame_source.h"

namespace curlew {

class DrawnLoop final : public FrameSource {
 public:
  /// How many frames are in the loop, and what the camera's clock says of them.
  struct Plan {
    std::int64_t frames = 1;       ///< in all, or fewer if the source ends before
    std::int64_t drawn_first = 1;  ///< of these, before the constructor returns; at least one
    std::int64_t interval_ns = 0;  ///< between two frames by the camera's clock
  };

  /// A thread of low priority draws the frames that are not drawn first. Throws what the source
  /// throws at its first frames, and Failure if it has none.
  DrawnLoop(std::unique_ptr<FrameSource> source, const Plan& plan);

  const FrameFormat& format() const override { return source_->format(); }
  std::int64_t frame_count() const override { return -1; }

  /// Delivers frame k modulo the number of frames that are drawn: in the end, k modulo
  /// plan.frames. The headers are those of the source, but for sequence, the camera's clock, which
  /// go on from lap to lap, and received. Allocates nothing. Throws Failure once drawing has
  /// failed.
  Delivery next(FrameBuffer& into) override;

  /// Returns how many frames are drawn.
  std::int64_t drawn() const { return drawn_.load(std::memory_order_acquire); }

 private:
  bool draw_one();
  void draw_rest(const std::stop_token& stop);

  std::unique_ptr<FrameSource> source_;
  Plan plan_;
  /// All are made beforehand. A frame is written before drawn_ counts it, and read afterwards.
  std::vector<std::unique_ptr<FrameBuffer>> frames_;
  std::atomic<std::int64_t> drawn_{0};
  std::string failure_;  ///< written before failed_ is set
  std::atomic<bool> failed_{false};
  std::int64_t delivered_ = 0;
  std::jthread drawing_;  ///< ends with the frame that it draws, before the rest is destroyed
};

}  // namespace curlew
