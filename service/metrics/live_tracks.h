// LiveTracks sums up the tracks of a live run, for a thread that shows them at any time.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "core/frame.h"
#include "core/vortex.h"
#include "service/frame_time.h"

namespace curlew {

/// What tracks were like up to now.
struct TracksSeen {
  std::int64_t now = 0;    ///< tracks of the last frame
  std::int64_t begun = 0;  ///< tracks so far
  std::int64_t ended = 0;  ///< those of them that are over
  double life_s = 0.0;     ///< sum over those, from each one's first frame to its last

  std::optional<double> mean_life_s() const {
    if (ended == 0) return {};
    return life_s / static_cast<double>(ended);
  }
};

/// One thread fills it and others read. It follows so many tracks at once; what is beyond is not
/// counted.
class LiveTracks {
 public:
  static constexpr std::size_t kMost = 512;

  /// Takes the vortices of a frame; frames come in their order. Never waits, locks or allocates.
  void add(const VortexList& vortices, const FrameHeader& header) noexcept {
    const double now_s = time_s(header);
    for (const Vortex& vortex : vortices)
      if (vortex.track >= 0) see(vortex.track, now_s);
    end_unseen();
    now_.store(static_cast<std::int64_t>(count_), std::memory_order_relaxed);
  }

  TracksSeen seen() const noexcept {
    const auto relaxed = std::memory_order_relaxed;
    return {now_.load(relaxed), begun_.load(relaxed), ended_.load(relaxed), life_s_.load(relaxed)};
  }

 private:
  struct Track {
    std::int64_t number = -1;
    double first_s = 0.0;
    double last_s = 0.0;
    bool seen = false;
  };

  void see(std::int64_t number, double now_s) noexcept {
    std::size_t i = 0;
    while (i < count_ && tracks_[i].number != number) ++i;
    if (i == kMost) return;
    if (i == count_) {
      tracks_[count_++] = {number, now_s, now_s, true};
      begun_.store(begun_.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
    }
    tracks_[i].last_s = now_s;
    tracks_[i].seen = true;
  }

  void end_unseen() noexcept {
    for (std::size_t i = 0; i < count_;) {
      Track& track = tracks_[i];
      if (track.seen) {
        track.seen = false;
        ++i;
        continue;
      }
      const double life_s = life_s_.load(std::memory_order_relaxed) + track.last_s - track.first_s;
      life_s_.store(life_s, std::memory_order_relaxed);
      ended_.store(ended_.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
      track = tracks_[--count_];
    }
  }

  std::array<Track, kMost> tracks_;
  std::size_t count_ = 0;
  std::atomic<std::int64_t> now_{0}, begun_{0}, ended_{0};
  std::atomic<double> life_s_{0.0};
};

}  // namespace curlew
