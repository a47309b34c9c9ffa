// AirWatch measures the air beside the live pipeline, in a thread of its own.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <thread>

#include "core/side_queue.h"
#include "service/air/air_meter.h"

namespace curlew {

class AirWatch {
 public:
  /// tell: the thread calls it with each report.
  AirWatch(const Plan& plan, const AirOptions& options, std::function<void(const AirReport&)> tell);
  ~AirWatch();
  AirWatch(const AirWatch&) = delete;
  AirWatch& operator=(const AirWatch&) = delete;

  /// The publisher's thread calls it once a frame. It never waits, locks or allocates: a frame for
  /// which there is no room does not count. Frames of another sensor do not count either.
  void add(const FrameSlot& slot) noexcept;

 private:
  struct Item {
    AirSample sample;
    std::int64_t frame_index = 0;
  };
  void work();

  std::string sensor_hash_;
  AirMeter meter_;
  std::function<void(const AirReport&)> tell_;
  SideQueue<Item> queue_;
  std::thread thread_;
};

}  // namespace curlew
