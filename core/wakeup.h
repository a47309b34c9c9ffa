// Wakeup lets one thread wait for others.
#pragma once

#include <semaphore.h>

#include <atomic>
#include <cerrno>
#include <cstdint>
#include <ctime>

namespace curlew {

/// Lets one thread wait for signals from any thread; each signal ends one wait. It spins for a
/// bounded time, then parks. Times are those of the monotonic clock, so that a step of the wall
/// clock neither ends nor prolongs a wait.
class Wakeup {
 public:
  Wakeup() noexcept { sem_init(&parked_, 0, 0); }
  ~Wakeup() { sem_destroy(&parked_); }
  Wakeup(const Wakeup&) = delete;
  Wakeup& operator=(const Wakeup&) = delete;

  void signal() noexcept {
    if (signals_.fetch_add(1, std::memory_order_acq_rel) < 0) sem_post(&parked_);
  }

  void wait() noexcept {
    if (spin(kSpins) || announce()) return;
    while (sem_wait(&parked_) != 0) continue;  // a signal to the process interrupted it
    signals_.load(std::memory_order_acquire);
  }

  /// Returns false if no signal came within timeout_us. With timeout_us 0 it only looks.
  bool wait_for(std::int64_t timeout_us) noexcept {
    if (timeout_us <= 0) return take();
    if (spin(kSpins) || announce()) return true;
    const timespec end = monotonic_in(timeout_us);
    int result = 0;
    do {
      result = sem_clockwait(&parked_, CLOCK_MONOTONIC, &end);
    } while (result != 0 && errno == EINTR);
    return result == 0 ? signals_.load(std::memory_order_acquire), true : !withdraw();
  }

 private:
  static constexpr int kSpins = 2000;  // about 10 µs

  static timespec monotonic_in(std::int64_t microseconds) noexcept {
    constexpr std::int64_t kNsPerS = 1'000'000'000;
    timespec time{};
    clock_gettime(CLOCK_MONOTONIC, &time);
    const std::int64_t ns = time.tv_nsec + microseconds % 1'000'000 * 1000;
    time.tv_sec += microseconds / 1'000'000 + ns / kNsPerS;
    time.tv_nsec = ns % kNsPerS;
    return time;
  }

  /// Takes a signal if there is one.
  bool take() noexcept {
    std::int64_t there = signals_.load(std::memory_order_acquire);
    while (there > 0)
      if (signals_.compare_exchange_weak(there, there - 1, std::memory_order_acq_rel)) return true;
    return false;
  }
  bool spin(int times) noexcept {
    for (int i = 0; i < times; ++i) {
      if (take()) return true;
      std::atomic_signal_fence(std::memory_order_acquire);  // The loop must not be optimised away.
    }
    return false;
  }
  /// Says that this thread is about to park. Returns true if there was a signal, which it takes.
  bool announce() noexcept { return signals_.fetch_sub(1, std::memory_order_acq_rel) > 0; }
  /// Takes the announcement back. Returns false if a signal came meanwhile, which it takes.
  bool withdraw() noexcept {
    std::int64_t there = signals_.load(std::memory_order_acquire);
    while (true) {
      if (there < 0) {
        if (signals_.compare_exchange_weak(there, there + 1, std::memory_order_acq_rel))
          return true;
      } else if (sem_trywait(&parked_) == 0) {
        return false;
      } else {
        there = signals_.load(std::memory_order_acquire);
      }
    }
  }

  std::atomic<std::int64_t> signals_{0};  ///< −1 while the thread that waits is parked
  sem_t parked_{};
};

}  // namespace curlew
