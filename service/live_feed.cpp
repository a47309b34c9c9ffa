#include "service/live_feed.h"

#include <utility>

namespace curlew {
namespace {

using Clock = std::chrono::steady_clock;
// A stop is noticed after this time at the latest, if no frames come.
constexpr std::int64_t kLookUpUs = 50'000;

}  // namespace

LiveFeed::LiveFeed(FrameExchange& exchange, const Limits& limits, FeedControl& control)
    : exchange_(exchange), limits_(limits), control_(control), next_index_(limits.first_index) {}

bool LiveFeed::fill(FrameSlot& slot) {
  const auto waiting_since = Clock::now();
  while (true) {
    control_.signs_of_life.fetch_add(1, std::memory_order_relaxed);
    if (control_.stop.load(std::memory_order_relaxed)) return finish(End::kStopped);
    if (next_index_ == limits_.end_index || Clock::now() >= limits_.until)
      return finish(End::kLimit);
    if (FrameBuffer* frame = exchange_.take(kLookUpUs)) {
      slot.frame = frame;
      slot.frame_index = next_index_++;
      return true;
    }
    if (exchange_.closed()) return finish(End::kClosed);
    const std::chrono::duration<double> waited = Clock::now() - waiting_since;
    if (limits_.timeout_s > 0.0 && waited.count() > limits_.timeout_s)
      return finish(End::kTimedOut);
  }
}

void LiveFeed::release(FrameSlot& slot) noexcept {
  exchange_.give_back(std::exchange(slot.frame, nullptr));
}

}  // namespace curlew
