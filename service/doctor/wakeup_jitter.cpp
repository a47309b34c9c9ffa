#include "service/doctor/wakeup_jitter.h"

#include <pthread.h>
#include <sched.h>

#include <cerrno>
#include <cstdint>
#include <ctime>
#include <thread>

#include "service/program/interrupt.h"
#include "service/realtime/realtime.h"

namespace curlew {
namespace {

constexpr std::int64_t kPeriod_ns = 1'000'000;
constexpr std::int64_t kSecond_ns = 1'000'000'000;

std::int64_t now_ns() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  return std::int64_t{now.tv_sec} * kSecond_ns + now.tv_nsec;
}

void sleep_until(std::int64_t due_ns) {
  const timespec due{.tv_sec = due_ns / kSecond_ns, .tv_nsec = due_ns % kSecond_ns};
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, nullptr) == EINTR) {
  }
}

bool has_real_time() {
  int policy = SCHED_OTHER;
  sched_param parameters{};
  pthread_getschedparam(pthread_self(), &policy, &parameters);
  return policy == SCHED_FIFO;
}

}  // namespace

WakeupJitter measure_wakeup_jitter(double seconds, const std::vector<int>& cpus, int priority) {
  WakeupJitter jitter;
  std::thread([&] {
    jitter.refused = enter_realtime("jitter", cpus, priority);
    if (priority > 0 && !has_real_time()) return;
    std::int64_t due_ns = now_ns() + kPeriod_ns;
    const std::int64_t end_ns = due_ns + static_cast<std::int64_t>(seconds * 1e9);
    while (due_ns < end_ns && !interrupted()) {
      sleep_until(due_ns);
      const std::int64_t woken_ns = now_ns();
      jitter.late_ns.record(woken_ns - due_ns);
      // Whole periods that were slept through are skipped.
      due_ns += kPeriod_ns * (1 + (woken_ns - due_ns) / kPeriod_ns);
    }
  }).join();
  return jitter;
}

}  // namespace curlew
