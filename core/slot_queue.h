// SlotQueue: hands slot pointers from one thread to the next. The only place that includes
// the moodycamel queue.
#pragma once

#include <concurrentqueue/concurrentqueue.h>
#include <concurrentqueue/lightweightsemaphore.h>

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <thread>

namespace curlew {

/// Spins for a bounded time, then parks. One waiting thread; signal() from any.
class Wakeup {
 public:
  void signal() noexcept { semaphore_.signal(); }
  void wait() noexcept { semaphore_.wait(); }
  /// false where no signal came in time. timeout_us 0 only looks.
  bool wait_for(std::int64_t timeout_us) noexcept {
    return timeout_us > 0 ? semaphore_.wait(timeout_us) : semaphore_.tryWait();
  }

 private:
  static constexpr int kSpins = 2000;  // some 10 µs
  moodycamel::LightweightSemaphore semaphore_{0, kSpins};
};

/// One producer thread, one consumer thread, first in first out, lock-free, allocates only when
/// made. pop() spins for a bounded time and then parks: a real-time thread that spins for ever
/// is stopped by the kernel.
template <typename Slot>
class SlotQueue {
 public:
  /// capacity: the most slots that can be queued at once.
  explicit SlotQueue(std::size_t capacity)
      : queue_(2 * capacity + kBlock, 1, 0), producer_(queue_) {}

  /// Producer only. The queue has room for every slot there is, so a refusal is spurious
  /// (a block not yet given back) and is tried again.
  void push(Slot* slot) noexcept {
    while (!queue_.try_enqueue(producer_, slot)) std::this_thread::yield();
    ready_.signal();
  }

  /// Producer only: no more will come. pop() delivers what is queued and then reports the end.
  void close() noexcept {
    closed_.store(true, std::memory_order_release);
    ready_.signal();
  }

  /// Consumer only. Waits for a slot; false when the queue is closed and drained.
  bool pop(Slot*& slot) noexcept {
    ready_.wait();
    return take(slot);
  }

  /// Consumer only. As pop(), but false also where none came in time; 0 does not wait at all.
  bool pop_for(Slot*& slot, std::int64_t timeout_us) noexcept {
    return ready_.wait_for(timeout_us) && take(slot);
  }

  /// Consumer only: closed, and nothing is left.
  bool ended() const noexcept {
    return closed_.load(std::memory_order_acquire) && queue_.size_approx() == 0;
  }

 private:
  static constexpr std::size_t kBlock = 64;  // the queue's blocks hold 32

  /// After one signal: a slot is there, or the queue is closed.
  bool take(Slot*& slot) noexcept {
    while (!queue_.try_dequeue_from_producer(producer_, slot)) {
      if (closed_.load(std::memory_order_acquire)) {
        if (queue_.try_dequeue_from_producer(producer_, slot)) return true;
        ready_.signal();  // stays at the end for further calls
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
