// SideQueue: copies of what the pipeline has, for work that may be slow: writing, printing.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "core/slot_queue.h"

namespace curlew {

/// A pool of items, made once. The producer claims one, fills it and sends it; where the consumer
/// has not yet given one back the producer goes on without and that is counted. Lock-free, one
/// producer thread, one consumer thread; the producer never waits.
template <typename Item>
class SideQueue {
 public:
  /// make: called `items` times, returns std::unique_ptr<Item>.
  template <typename Make>
  SideQueue(std::size_t items, Make&& make) : free_(items), sent_(items) {
    for (std::size_t i = 0; i < items; ++i) {
      items_.push_back(make());
      free_.push(items_.back().get());
    }
  }

  std::size_t items() const noexcept { return items_.size(); }

  /// Producer: an item to fill; nullptr where all are taken, which counts as dropped.
  Item* claim() noexcept {
    Item* item = nullptr;
    if (free_.pop_for(item, 0)) return item;
    dropped_.fetch_add(1, std::memory_order_relaxed);
    return nullptr;
  }
  void send(Item* item) noexcept { sent_.push(item); }
  /// Producer: no more will be sent.
  void close() noexcept { sent_.close(); }

  /// Consumer: waits for an item; false when closed and drained.
  bool take(Item*& item) noexcept { return sent_.pop(item); }
  /// Consumer: false also where none came in time; ended() tells the difference.
  bool take_for(Item*& item, std::int64_t timeout_us) noexcept {
    return sent_.pop_for(item, timeout_us);
  }
  bool ended() const noexcept { return sent_.ended(); }
  void give_back(Item* item) noexcept { free_.push(item); }

  std::int64_t dropped() const noexcept { return dropped_.load(std::memory_order_relaxed); }

 private:
  std::vector<std::unique_ptr<Item>> items_;
  SlotQueue<Item> free_;
  SlotQueue<Item> sent_;
  std::atomic<std::int64_t> dropped_{0};
};

}  // namespace curlew
