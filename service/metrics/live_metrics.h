// LiveMetrics counts what the daemon's results were like, for a thread that shows it at any time.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>

#include "service/metrics/live_tracks.h"
#include "service/stages.h"

namespace curlew {

/// A histogram that one thread fills and others read. A bucket counts the times up to its bound.
class LiveHistogram {
 public:
  /// The upper bounds of the buckets, in ns. What is longer is in the last bucket, which has none.
  static constexpr std::array<std::int64_t, 17> kBounds = {
      1'000,      2'500,      5'000,       10'000,      25'000,       50'000,
      100'000,    250'000,    500'000,     1'000'000,   2'500'000,    5'000'000,
      10'000'000, 25'000'000, 100'000'000, 500'000'000, 2'500'000'000};

  void add(std::int64_t ns) noexcept {
    std::size_t bucket = 0;
    while (bucket < kBounds.size() && ns > kBounds[bucket]) ++bucket;
    increase(counts_[bucket], 1);
    increase(sum_ns_, ns);
  }
  std::int64_t count(std::size_t bucket) const noexcept {
    return counts_[bucket].load(std::memory_order_relaxed);
  }
  std::int64_t sum_ns() const noexcept { return sum_ns_.load(std::memory_order_relaxed); }

  /// Adds to a number that no other thread changes, without the cost of a locked instruction.
  static void increase(std::atomic<std::int64_t>& number, std::int64_t by) noexcept {
    number.store(number.load(std::memory_order_relaxed) + by, std::memory_order_relaxed);
  }

 private:
  std::array<std::atomic<std::int64_t>, kBounds.size() + 1> counts_{};
  std::atomic<std::int64_t> sum_ns_{0};
};

struct LiveMetrics {
  using Number = std::atomic<std::int64_t>;

  /// The publisher's thread calls this once a frame, when its latency is complete. It never waits,
  /// locks or allocates.
  void add(const FrameSlot& slot) noexcept {
    for (std::size_t i = 0; i < kStageCount; ++i) stages[i].add(slot.latency.stage_ns[i]);
    publish.add(slot.latency.publish_ns);
    total.add(slot.latency.total_ns);
    const std::uint32_t status = slot.frame->header.status;
    LiveHistogram::increase(results, 1);
    LiveHistogram::increase(late, (status & kFrameLate) != 0 ? 1 : 0);
    LiveHistogram::increase(saturated, (status & kFrameSaturated) != 0 ? 1 : 0);
    LiveHistogram::increase(vortices, static_cast<std::int64_t>(slot.vortices.size()));
    LiveHistogram::increase(overflow, static_cast<std::int64_t>(slot.vortices.overflow()));
    tracks.add(slot.vortices, slot.frame->header);
    LiveHistogram::increase(not_converged, slot.split.converged ? 0 : 1);
    const auto now = std::memory_order_relaxed;
    vortices_now.store(static_cast<std::int64_t>(slot.vortices.size()), now);
    lenslets_now.store(slot.slopes.n_valid, now);
    lost_now.store(slot.centroids.n_lost, now);
    const double scale_adu = slot.frame->format().scale_adu;
    noise_adu.store(slot.levels ? scale_adu * static_cast<double>(slot.levels->noise) : 0.0, now);
    level_adu.store(slot.levels ? scale_adu * middle_level(*slot.levels) : 0.0, now);
  }

  std::array<LiveHistogram, kStageCount> stages;
  LiveHistogram publish;
  LiveHistogram total;
  Number results{0}, late{0}, saturated{0}, vortices{0}, overflow{0}, not_converged{0};
  LiveTracks tracks;
  Number vortices_now{0}, lenslets_now{0}, lost_now{0};  ///< of the last frame
  std::atomic<double> noise_adu{0.0};  ///< of the last frame's pixels between the spots, rms
  std::atomic<double> level_adu{0.0};  ///< in the middle of the last frame, above the dark

 private:
  static double middle_level(const FrameLevels& levels) noexcept {
    return static_cast<double>(levels.level(levels.level.rows() / 2, levels.level.cols() / 2));
  }
};

}  // namespace curlew
