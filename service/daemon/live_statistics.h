// LiveStatistics sums up the last second of results. The publisher's thread fills it, and another
// thread shows it.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>

#include "core/latency_histogram.h"
#include "core/side_queue.h"
#include "service/stages.h"

namespace curlew {

/// This sums up the results of about a second. The latencies are from the receipt of a frame to its
/// results.
struct StatusWindow {
  std::int64_t frames = 0;
  std::int64_t vortices_now = 0;  ///< It counts the vortices of the last frame.
  std::int64_t late = 0;          ///< It counts the frames that missed the deadline.
  std::int64_t measured = 0;      ///< It counts the frames with a slope.
  std::int64_t dark = 0;          ///< It counts the frames without light.
  std::int64_t valid_now = 0;     ///< It counts the lenslets of the last frame with a slope,
  std::int64_t lost_now = 0;      ///< and those without a spot of their own.
  double seconds = 0.0;
  std::int64_t p50_ns = 0;
  std::int64_t p99_ns = 0;
  std::int64_t max_ns = 0;

  double frames_per_s() const { return frames > 0 ? static_cast<double>(frames) / seconds : 0.0; }
};

class LiveStatistics {
 public:
  LiveStatistics() : windows_(8, [] { return std::make_unique<StatusWindow>(); }) {}

  /// The publisher's thread calls this once a frame. It never waits or allocates.
  void add(const FrameSlot& slot) noexcept {
    ++current_.frames;
    current_.vortices_now = static_cast<std::int64_t>(slot.vortices.size());
    current_.measured += slot.slopes.n_valid > 0 ? 1 : 0;
    current_.dark += is_dark(slot) ? 1 : 0;
    current_.valid_now = slot.slopes.n_valid;
    current_.lost_now = slot.centroids.n_lost;
    current_.late += (slot.frame->header.status & kFrameLate) != 0 ? 1 : 0;
    latency_.record(slot.latency.total_ns);
    const auto now = std::chrono::steady_clock::now();
    const std::chrono::duration<double> elapsed = now - since_;
    if (elapsed.count() < 1.0) return;
    current_.seconds = elapsed.count();
    current_.p50_ns = latency_.percentile_ns(0.5);
    current_.p99_ns = latency_.percentile_ns(0.99);
    current_.max_ns = latency_.max_ns();
    if (StatusWindow* window = windows_.claim()) {
      *window = current_;
      windows_.send(window);
    }
    current_ = {};
    latency_ = {};
    since_ = now;
  }

  /// The other thread calls this. It gives the newest window since the last call, with the late
  /// frames of all windows since then; false where there is none.
  bool take(StatusWindow& window) noexcept {
    bool any = false;
    StatusWindow* taken = nullptr;
    while (windows_.take_for(taken, 0)) {
      const std::int64_t late_before = any ? window.late : 0;
      window = *taken;
      window.late += late_before;
      windows_.give_back(taken);
      any = true;
    }
    return any;
  }

 private:
  /// Without a follower, no light is no lenslet that is more than faint.
  static bool is_dark(const FrameSlot& slot) noexcept {
    if (slot.follower != nullptr && slot.follow_state == FollowState::kNoLight) return true;
    return slot.slopes.n_valid == 0 &&
           std::all_of(slot.centroids.state.begin(), slot.centroids.state.end(),
                       [](LensletState state) {
                         return state == LensletState::kFaint || state == LensletState::kUnlit;
                       });
  }

  SideQueue<StatusWindow> windows_;
  StatusWindow current_;
  LatencyHistogram latency_;
  std::chrono::steady_clock::time_point since_ = std::chrono::steady_clock::now();
};

}  // namespace curlew
