#include "core/team.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cstddef>
#include <random>
#include <thread>
#include <vector>

namespace curlew {
namespace {

/// Threads that help a team until they are told to end.
class Helpers {
 public:
  Helpers(Team& team, int n) : team_(team) {
    for (int i = 0; i < n; ++i)
      threads_.emplace_back([this] { team_.wait_until([this] { return ended_.load(); }); });
  }
  ~Helpers() {
    ended_ = true;
    team_.ring();
    for (std::thread& thread : threads_) thread.join();
  }
  Helpers(const Helpers&) = delete;
  Helpers& operator=(const Helpers&) = delete;

 private:
  Team& team_;
  std::atomic<bool> ended_{false};
  std::vector<std::thread> threads_;
};

// What pieces wrote, without any atomics, is there when share() returns.
TEST(Team, EachPieceIsDoneOnceWhoeverHelps) {
  constexpr unsigned kSeed = 20261130;
  SCOPED_TRACE(kSeed);
  std::mt19937 random(kSeed);
  for (const int helpers : {0, 1, 3}) {
    Team team;
    const Helpers help(team, helpers);
    for (int round = 0; round < 3000; ++round) {
      const int n = std::uniform_int_distribution(0, 40)(random);
      std::vector<int> done(static_cast<std::size_t>(n));
      std::vector<int> values(static_cast<std::size_t>(n));
      team.share(n, [&](int i) {
        ++done[static_cast<std::size_t>(i)];
        values[static_cast<std::size_t>(i)] = i * round;
      });
      for (int i = 0; i < n; ++i) {
        ASSERT_EQ(done[static_cast<std::size_t>(i)], 1) << "round " << round;
        ASSERT_EQ(values[static_cast<std::size_t>(i)], i * round);
      }
    }
  }
}

// Helpers have parked long before the work comes, and it is too much for one thread to do before
// they wake.
TEST(Team, ThoseThatHaveParkedWakeAndHelp) {
  Team team;
  const Helpers help(team, 2);
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  const std::thread::id self = std::this_thread::get_id();
  std::atomic<int> by_others{0};
  team.share(20, [&](int) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    if (std::this_thread::get_id() != self) ++by_others;
  });
  EXPECT_GT(by_others, 0);
  EXPECT_LT(by_others, 20) << "the thread that shares works as well";
}

TEST(Team, WhoWaitsSeesWhatWasWrittenBeforeTheBell) {
  Team team;
  std::atomic<int> turn{0};
  int value = 0;
  std::thread other([&] {
    for (int i = 1; i <= 2000; i += 2) {
      team.wait_until([&] { return turn.load(std::memory_order_acquire) == i; });
      EXPECT_EQ(value, i);
      ++value;
      turn.store(i + 1, std::memory_order_release);
      team.ring();
    }
  });
  for (int i = 0; i < 2000; i += 2) {
    team.wait_until([&] { return turn.load(std::memory_order_acquire) == i; });
    EXPECT_EQ(value, i);
    ++value;
    turn.store(i + 1, std::memory_order_release);
    team.ring();
  }
  other.join();
  EXPECT_EQ(value, 2000);
}

TEST(Team, RowsAreCutWithoutGapsOrOverlaps) {
  for (const int first : {0, 3}) {
    for (const int last : {first, first + 1, first + 15, first + 16, first + 17, first + 83}) {
      Team team;
      const Helpers help(team, 1);
      for (Team* with : {static_cast<Team*>(nullptr), &team}) {
        std::vector<std::atomic<int>> seen(100);
        share_rows(with, first, last, [&](int piece, int begin, int end) {
          EXPECT_LT(piece, kTeamPieces);
          for (int r = begin; r < end; ++r) ++seen[static_cast<std::size_t>(r)];
        });
        for (int r = 0; r < 100; ++r)
          EXPECT_EQ(seen[static_cast<std::size_t>(r)], r >= first && r < last ? 1 : 0);
      }
    }
  }
}

}  // namespace
}  // namespace curlew
