// A FrameExchange hands frames from a camera's thread to the pipeline, newest first.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "core/frame.h"
#include "core/memory_limit.h"
#include "core/slot_queue.h"
#include "core/wakeup.h"

namespace curlew {

/// Owns a pool of frame buffers, made once. The camera fills empty ones and delivers them; the
/// pipeline takes the newest and gives it back. A frame that still waits when a newer one comes is
/// superseded: the camera gets its buffer back at once, so it never lacks a buffer because the
/// pipeline is slow. The exchange is lock-free and allocates nothing after the constructor. At any
/// time only one thread may act as the camera, only one may take and only one may give back.
class FrameExchange {
 public:
  /// buffers: as many as the pipeline can hold at once, one that waits, and those that the camera
  /// fills. Throws Failure if they take more than memory_limit_bytes().
  FrameExchange(const FrameFormat& format, std::size_t buffers) : empty_(buffers) {
    require_memory(std::to_string(buffers) +
                       " frame buffers (buffers in [camera], slots in "
                       "[pipeline]) of " +
                       std::to_string(format.bytes()) + " bytes",
                   static_cast<double>(buffers) * static_cast<double>(format.bytes()));
    unused_.reserve(buffers);
    for (std::size_t i = 0; i < buffers; ++i) {
      buffers_.push_back(std::make_unique<FrameBuffer>(format));
      empty_.push(buffers_.back().get());
    }
  }

  std::size_t buffers() const noexcept { return buffers_.size(); }

  /// For the camera's thread: returns a buffer to fill, or nullptr while none is free.
  FrameBuffer* empty() noexcept {
    FrameBuffer* buffer = nullptr;
    if (!unused_.empty()) {
      buffer = unused_.back();
      unused_.pop_back();
      return buffer;
    }
    return empty_.pop_for(buffer, 0) ? buffer : nullptr;
  }

  /// For the camera's thread: takes back a buffer that empty() or deliver() returned and that the
  /// camera has no use for, as when it stops.
  void put_back(FrameBuffer* buffer) noexcept { unused_.push_back(buffer); }

  /// For the camera's thread: hands on `frame`, which is whole and has its header. Returns the
  /// buffer of the frame that it supersedes, to be filled again, or nullptr if none waited.
  FrameBuffer* deliver(FrameBuffer* frame) noexcept {
    count_delivered();
    return hand_on(frame);
  }

  /// For the camera's thread: hands on `frame` with its first rows, while others still arrive
  /// (core/readout.h). Returns what deliver() returns. When its last row is there,
  /// count_delivered() is due.
  FrameBuffer* hand_on(FrameBuffer* frame) noexcept {
    FrameBuffer* old = newest_.exchange(frame, std::memory_order_acq_rel);
    if (old != nullptr)
      superseded_.fetch_add(1, std::memory_order_relaxed);
    else
      ready_.signal();
    return old;
  }

  void count_delivered() noexcept { delivered_.fetch_add(1, std::memory_order_relaxed); }

  /// For the camera's thread: takes back a frame that was handed on and broke off. Returns false if
  /// the pipeline has it already, which then gives it back.
  bool take_back(FrameBuffer* frame) noexcept {
    FrameBuffer* expected = frame;
    return newest_.compare_exchange_strong(expected, nullptr, std::memory_order_acq_rel);
  }

  /// For any thread: says that no more frames will come. A frame that waits can still be taken.
  void close() noexcept {
    closed_.store(true, std::memory_order_release);
    ready_.signal();
  }
  bool closed() const noexcept { return closed_.load(std::memory_order_acquire); }

  /// For the pipeline: returns the newest frame. Returns nullptr if none came within timeout_us, or
  /// if the exchange is closed and no frame waits.
  FrameBuffer* take(std::int64_t timeout_us) noexcept {
    if (!closed() && !ready_.wait_for(timeout_us)) return nullptr;
    return newest_.exchange(nullptr, std::memory_order_acq_rel);
  }

  /// For the pipeline: returns a frame whose pixels it no longer needs.
  void give_back(FrameBuffer* frame) noexcept { empty_.push(frame); }

  /// These count the frames that the camera delivered, and those among them that a newer one
  /// superseded.
  std::int64_t delivered() const noexcept { return delivered_.load(std::memory_order_relaxed); }
  std::int64_t superseded() const noexcept { return superseded_.load(std::memory_order_relaxed); }

 private:
  std::vector<std::unique_ptr<FrameBuffer>> buffers_;
  SlotQueue<FrameBuffer> empty_;      // buffers on their way from the pipeline to the camera
  std::vector<FrameBuffer*> unused_;  // buffers that the camera put back
  std::atomic<FrameBuffer*> newest_{nullptr};
  Wakeup ready_;  // gets one signal for each frame that found no other one waiting
  std::atomic<bool> closed_{false};
  std::atomic<std::int64_t> delivered_{0};
  std::atomic<std::int64_t> superseded_{0};
};

}  // namespace curlew
