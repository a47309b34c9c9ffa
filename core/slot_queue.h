// A SlotQueue hands slot pointers from one thread to the next. No other file includes the
// moodycamel queue.
#pragma once

#include <concurrentqueue/concurrentqueue.h>

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <thread>

#include "core/wakeup.h"

namespace curlew {

/// A queue, first in, first out, for one producer thread and one consumer thread at a time, which
/// may hand that part on to another. It is lock-free and allocates only when made. pop() spins for
/// a bounded time and then parks, because the kernel stops a real-time thread that spins for ever.
template <typename Slot>
class SlotQueue {
 public:
  /// capacity: the most slots that can be queued at once.
  explicit SlotQueue(std::size_t capacity)
      : queue_(2 * capacity + kBlock, 1, 0), producer_(queue_) {}

  /// For the producer only. The queue has room for every slot there is, so a refusal only means
  /// that a block is not yet given back, and the push is tried again.
  void push(Slot* slot) noexcept {
    while (!queue_.try_enqueue(producer_, slot)) std::this_thread::yield();
    ready_.signal();
  }

  /// For the producer only: says that no more slots will come. pop() delivers what is queued and
  /// then reports the end.
  void close() noexcept {
    closed_.store(true, std::memory_order_release);
    ready_.signal();
  }

  /// For the consumer only: waits for a slot. Returns false when the queue is closed and drained.
  bool pop(Slot*& slot) noexcept {
    ready_.wait();
    return take(slot);
  }

  /// For the consumer only: as pop(), but returns false also if no slot came within timeout_us.
  /// With timeout_us 0 it does not wait at all.
  bool pop_for(Slot*& slot, std::int64_t timeout_us) noexcept {
    return ready_.wait_for(timeout_us) && take(slot);
  }

  /// For the consumer only: says whether the queue is closed and nothing is left.
  bool ended() const noexcept {
    return closed_.load(std::memory_order_acquire) && queue_.size_approx() == 0;
  }

 private:
  static constexpr std::size_t kBlock = 64;  // two blocks of the moodycamel queue

  /// Takes a slot after one signal, which means that a slot is there or that the queue is closed.
  bool take(Slot*& slot) noexcept {
    while (!queue_.try_dequeue_from_producer(producer_, slot)) {
      if (closed_.load(std::memory_order_acquire)) {
        if (queue_.try_dequeue_from_producer(producer_, slot)) return true;
        ready_.signal();  // Further calls find the end as well.
        return false;
      }
    }
    return true;
  }

  moodycamel::ConcurrentQueue<Slot*> queue_;
  moodycamel::ProducerToken producer_;
  Wakeup ready_;
  std::atomic<bool> closed_{false};
};

}  // namespace curlew
