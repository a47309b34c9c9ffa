// FrameSnapshot takes one frame with all its results out of the running pipeline.
#pragma once

#include <atomic>
#include <chrono>
#include <memory>
#include <string>

#include "core/frame.h"
#include "service/stages.h"

namespace curlew {

/// Holds copies of a frame and of its results, with room for those of one plan.
class FrameSnapshot {
 public:
  FrameSnapshot(std::shared_ptr<const Plan> plan, const FrameFormat& format);

  /// Says whether there is room for the results of this frame.
  bool fits(const FrameSlot& slot) const noexcept { return slot.plan == plan_.get(); }
  /// Copies what a results file holds. Never allocates.
  void copy(const FrameSlot& slot) noexcept;
  /// Returns the bytes of a results file (docs/files.md) of this one frame, with all images and the
  /// frame itself. Throws Failure if it cannot be written into the system's temporary folder.
  std::string file() const;

 private:
  std::shared_ptr<const Plan> plan_;
  FrameBuffer frame_;
  FrameSlot slot_;
};

/// One thread wants snapshots, and the publisher's thread fills them.
class SnapshotExchange {
 public:
  /// The publisher's thread offers each frame. It copies one that is wanted, and never waits, locks
  /// or allocates.
  void offer(const FrameSlot& slot) noexcept {
    FrameSnapshot* wanted = wanted_.load(std::memory_order_acquire);
    if (wanted != nullptr) fill(*wanted, slot);
  }

  /// Waits until a frame has filled the snapshot. Returns false if none came in time. Only one
  /// thread at a time may call it.
  bool wait(FrameSnapshot& snapshot, std::chrono::milliseconds patience);

 private:
  void fill(FrameSnapshot& wanted, const FrameSlot& slot) noexcept;

  std::atomic<FrameSnapshot*> wanted_{nullptr};
  std::atomic<bool> filling_{false};
};

}  // namespace curlew
