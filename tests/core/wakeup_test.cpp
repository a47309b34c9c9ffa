#include "core/wakeup.h"

#include <gtest/gtest.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <chrono>
#include <future>
#include <thread>

namespace {

std::atomic<std::int64_t> wall_clock_step_s{0};

}  // namespace

/// Stands in for the C library's, in this program: the wall clock can be set to another time.
extern "C" int clock_gettime(clockid_t clock, timespec* time) noexcept {
  const auto result = static_cast<int>(syscall(SYS_clock_gettime, clock, time));
  if (clock == CLOCK_REALTIME) time->tv_sec += wall_clock_step_s;
  return result;
}

namespace curlew {
namespace {

using std::chrono::milliseconds;
using Clock = std::chrono::steady_clock;

TEST(Wakeup, EachSignalEndsOneWait) {
  Wakeup wakeup;
  EXPECT_FALSE(wakeup.wait_for(0));
  wakeup.signal();
  wakeup.signal();
  wakeup.wait();
  EXPECT_TRUE(wakeup.wait_for(0));
  EXPECT_FALSE(wakeup.wait_for(0));
  const auto begin = Clock::now();
  EXPECT_FALSE(wakeup.wait_for(20'000));
  EXPECT_GE(Clock::now() - begin, milliseconds(20));
}

// Signals come at all moments of waits that time out. None may be lost, and none counted twice.
TEST(Wakeup, NoSignalIsLostBetweenATimeoutAndASignal) {
  constexpr int kSignals = 20'000;
  Wakeup wakeup;
  std::thread signals([&] {
    for (int i = 0; i < kSignals; ++i) {
      wakeup.signal();
      if (i % 8 == 0) std::this_thread::sleep_for(std::chrono::microseconds(i % 70));
    }
  });
  int heard = 0;
  int silent = 0;
  while (heard < kSignals && silent < 5000) wakeup.wait_for(60) ? ++heard : ++silent;
  signals.join();
  while (wakeup.wait_for(0)) ++heard;
  EXPECT_EQ(heard, kSignals);
}

TEST(Wakeup, AStepOfTheWallClockNeitherEndsNorProlongsAWait) {
  constexpr std::int64_t kHour_s = 3600;
  for (const std::int64_t step_s : {kHour_s, -kHour_s, 24 * kHour_s, -24 * kHour_s}) {
    wall_clock_step_s = step_s;
    Wakeup wakeup;
    const auto begin = Clock::now();
    auto heard = std::async(std::launch::async, [&] { return wakeup.wait_for(100'000); });
    const bool ended = heard.wait_for(std::chrono::seconds(10)) == std::future_status::ready;
    EXPECT_TRUE(ended) << step_s;
    if (!ended) wakeup.signal();
    EXPECT_FALSE(heard.get());
    EXPECT_GE(Clock::now() - begin, milliseconds(100)) << step_s;
    wall_clock_step_s = 0;
  }
}

}  // namespace
}  // namespace curlew
