// FrameExchange: hands frames from a camera's thread to the pipeline, newest first.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "core/frame.h"
#include "core/slot_queue.h"

namespace curlew {

/// A ring of frame buffers, made once. The camera fills empty ones and delivers them; the pipeline
/// takes the newest and gives it back. A frame that waits when a newer one comes is superseded:
/// the camera gets its buffer back at once, so it never runs out of buffers for our slowness.
/// Lock-free; nothing is allocated after the constructor. Two threads on the camera's side would
/// be one too many, and so would two that take or two that give back.
class FrameExchange {
 public:
  /// buffers: those the pipeline can hold at once, one waiting, and those the camera fills.
  FrameExchange(const FrameFormat& format, std::size_t buffers) : empty_(buffers) {
    unused_.reserve(buffers);
    for (std::size_t i = 0; i < buffers; ++i) {
      buffers_.push_back(std::make_unique<FrameBuffer>(format));
      empty_.push(buffers_.back().get());
    }
  }

  std::size_t buffers() const noexcept { return buffers_.size(); }

  /// Camera's thread: a buffer to fill; nullptr while none is free.
  FrameBuffer* empty() noexcept {
    FrameBuffer* buffer = nullptr;
    if (!unused_.empty()) {
      buffer = unused_.back();
      unused_.pop_back();
      return buffer;
    }
    return empty_.pop_for(buffer, 0) ? buffer : nullptr;
  }

  /// Camera's thread: a buffer that empty() or deliver() returned and that it has no use for, as
  /// when it stops.
  void put_back(FrameBuffer* buffer) noexcept { unused_.push_back(buffer); }

  /// Camera's thread: `frame` is whole, its header set. Returns the buffer of the frame it
  /// supersedes, to be filled again; nullptr where none waited.
  FrameBuffer* deliver(FrameBuffer* frame) noexcept {
    delivered_.fetch_add(1, std::memory_order_relaxed);
    FrameBuffer* old = newest_.exchange(frame, std::memory_order_acq_rel);
    if (old != nullptr)
      superseded_.fetch_add(1, std::memory_order_relaxed);
    else
      ready_.signal();
    return old;
  }

  /// Any thread: no more frames will come. What waits can still be taken.
  void close() noexcept {
    closed_.store(true, std::memory_order_release);
    ready_.signal();
  }
  bool closed() const noexcept { return closed_.load(std::memory_order_acquire); }

  /// Pipeline: the newest frame; nullptr where none came in time or the exchange is closed.
  FrameBuffer* take(std::int64_t timeout_us) noexcept {
    if (!closed() && !ready_.wait_for(timeout_us)) return nullptr;
    return newest_.exchange(nullptr, std::memory_order_acq_rel);
  }

  /// Pipeline: the frame's pixels are no longer needed.
  void give_back(FrameBuffer* frame) noexcept { empty_.push(frame); }

  /// Frames the camera delivered, and those among them that a newer one replaced.
  std::int64_t delivered() const noexcept { return delivered_.load(std::memory_order_relaxed); }
  std::int64_t superseded() const noexcept { return superseded_.load(std::memory_order_relaxed); }

 private:
  std::vector<std::unique_ptr<FrameBuffer>> buffers_;
  SlotQueue<FrameBuffer> empty_;      // from the pipeline to the camera
  std::vector<FrameBuffer*> unused_;  // put back by the camera
  std::atomic<FrameBuffer*> newest_{nullptr};
  Wakeup ready_;  // one signal a frame that found no other waiting
  std::atomic<bool> closed_{false};
  std::atomic<std::int64_t> delivered_{0};
  std::atomic<std::int64_t> superseded_{0};
};

}  // namespace curlew
