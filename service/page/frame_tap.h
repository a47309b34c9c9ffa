// FrameTap lets one viewer's thread look at frames as they pass, at no cost where it does not look.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "service/page/asked_copy.h"
#include "service/page/frame_copy.h"
#include "service/stages.h"

namespace curlew {

/// A copy that the viewer's thread asks for, and the publisher's thread makes of the next frame.
class FrameTap {
 public:
  /// The publisher's thread calls this once a frame, when its latency is complete. It never waits,
  /// locks or allocates, and copies only what was asked for.
  void pass(const FrameSlot& slot, std::int64_t dropped) noexcept {
    const std::size_t next = passed_.load(std::memory_order_relaxed);
    latencies_[next % kLatencies].set(slot.latency);
    passed_.store(next + 1, std::memory_order_release);
    copy_.offer(slot, dropped);
  }

  /// The viewer's thread calls these two: see AskedCopy.
  const FrameCopy* answer() { return copy_.answer(); }
  void ask() { copy_.ask(); }

  /// Returns the latencies of the last thousand frames or so, in no order. Any thread may call it.
  std::vector<FrameLatency> latencies() const {
    const std::size_t passed = passed_.load(std::memory_order_acquire);
    std::vector<FrameLatency> all(passed < kLatencies ? passed : kLatencies);
    for (std::size_t i = 0; i < all.size(); ++i) all[i] = latencies_[i].value();
    return all;
  }

 private:
  static constexpr std::size_t kLatencies = 1024;

  /// A latency that one thread writes and others read. Its figures may be of two frames.
  class SharedLatency {
   public:
    void set(const FrameLatency& latency) noexcept {
      for (std::size_t i = 0; i < kStageCount; ++i) put(i, latency.stage_ns[i]);
      put(kStageCount, latency.publish_ns);
      put(kStageCount + 1, latency.total_ns);
    }
    FrameLatency value() const noexcept {
      FrameLatency latency;
      for (std::size_t i = 0; i < kStageCount; ++i) latency.stage_ns[i] = at(i);
      latency.publish_ns = at(kStageCount);
      latency.total_ns = at(kStageCount + 1);
      return latency;
    }

   private:
    void put(std::size_t i, std::int64_t ns) noexcept {
      ns_[i].store(ns, std::memory_order_relaxed);
    }
    std::int64_t at(std::size_t i) const noexcept { return ns_[i].load(std::memory_order_relaxed); }

    std::array<std::atomic<std::int64_t>, kStageCount + 2> ns_{};
  };

  AskedCopy<FrameCopy> copy_;
  std::array<SharedLatency, kLatencies> latencies_;
  std::atomic<std::size_t> passed_{0};
};

}  // namespace curlew
