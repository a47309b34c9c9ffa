#include "service/air/air_watch.h"

#include <memory>
#include <optional>
#include <utility>

namespace curlew {
namespace {

constexpr std::size_t kWaiting = 64;  // samples

}  // namespace

AirWatch::AirWatch(const Plan& plan, const AirOptions& options,
                   std::function<void(const AirReport&)> tell)
    : sensor_hash_(plan.sensor_hash),
      meter_(plan, options),
      tell_(std::move(tell)),
      queue_(kWaiting,
             [this] {
               return std::make_unique<Item>(Item{meter_.make_sample(), 0});
             }),
      thread_([this] { work(); }) {}

AirWatch::~AirWatch() {
  queue_.close();
  thread_.join();
}

void AirWatch::add(const FrameSlot& slot) noexcept {
  if (slot.plan->sensor_hash != sensor_hash_) return;
  Item* item = queue_.claim();
  if (item == nullptr) return;
  AirMeter::fill(slot, item->sample);
  item->frame_index = slot.frame_index;
  queue_.send(item);
}

void AirWatch::work() {
  Item* item = nullptr;
  while (queue_.take(item)) {
    const std::optional<AirReport> complete = meter_.add(item->sample, item->frame_index);
    queue_.give_back(item);
    if (complete) tell_(*complete);
  }
}

}  // namespace curlew
