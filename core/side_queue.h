// A SideQueue hands copies of what the pipeline has to work that may be slow, as writing or
// printing.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "core/slot_queue.h"

namespace curlew {

/// Owns a pool of items, made once. The producer claims one, fills it and sends it. If the consumer
/// has given none back in time, the producer goes on without one, and that is counted. The queue is
/// lock-free, for one producer thread and one consumer thread; the producer never waits.
template <typename Item>
class SideQueue {
 public:
  /// make: is called `items` times and returns a std::unique_ptr<Item>.
  template <typename Make>
  SideQueue(std::size_t items, Make&& make) : free_(items), sent_(items) {
    for (std::size_t i = 0; i < items; ++i) {
      items_.push_back(make());
      free_.push(items_.back().get());
    }
  }

  std::size_t items() const noexcept { return items_.size(); }

  /// For the producer: returns an item to fill, or nullptr if all are taken, which counts as
  /// dropped.
  Item* claim() noexcept {
    Item* item = nullptr;
    if (free_.pop_for(item, 0)) return item;
    dropped_.fetch_add(1, std::memory_order_relaxed);
    return nullptr;
  }
  /// For the producer: hands an item that it claimed to the consumer.
  void send(Item* item) noexcept { sent_.push(item); }
  /// For the producer: says that no more items will be sent.
  void close() noexcept { sent_.close(); }

  /// For the consumer: waits for an item. Returns false when the queue is closed and drained.
  bool take(Item*& item) noexcept { return sent_.pop(item); }
  /// For the consumer: as take(), but returns false also if no item came within timeout_us; ended()
  /// tells the difference.
  bool take_for(Item*& item, std::int64_t timeout_us) noexcept {
    return sent_.pop_for(item, timeout_us);
  }
  bool ended() const noexcept { return sent_.ended(); }
  /// For the consumer: returns an item that it has taken.
  void give_back(Item* item) noexcept { free_.push(item); }

  /// Returns how often claim() found no item.
  std::int64_t dropped() const noexcept { return dropped_.load(std::memory_order_relaxed); }

 private:
  std::vector<std::unique_ptr<Item>> items_;
  SlotQueue<Item> free_;
  SlotQueue<Item> sent_;
  std::atomic<std::int64_t> dropped_{0};
};

}  // namespace curlew
