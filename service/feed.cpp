#include "service/feed.h"

#include <thread>

#include "service/program/interrupt.h"

namespace curlew {

using Clock = std::chrono::steady_clock;

RecordedFeed::RecordedFeed(FrameSource& source, const RunOptions& options)
    : source_(source), options_(options), next_(Clock::now()) {}

bool RecordedFeed::fill(FrameSlot& slot) {
  if (delivered_ == options_.max_frames || interrupted()) return false;
  if (slot.frame == nullptr) {
    buffers_.push_back(std::make_unique<FrameBuffer>(source_.format()));
    slot.frame = buffers_.back().get();
  }
  if (source_.next(*slot.frame) == Delivery::kEnd) return false;
  if (options_.pace_hz > 0.0) {
    std::this_thread::sleep_until(next_);
    slot.frame->header.received = Clock::now();
    // The next frame is due one period from now, not one period after this one was due. So frames
    // do not come in a burst after a stall.
    next_ =
        slot.frame->header.received + std::chrono::duration_cast<Clock::duration>(
                                          std::chrono::duration<double>(1.0 / options_.pace_hz));
  }
  slot.frame_index = options_.first_frame + delivered_++;
  return true;
}

void RecordedFeed::release(FrameSlot&) noexcept {}  // the slot keeps its buffer

}  // namespace curlew
