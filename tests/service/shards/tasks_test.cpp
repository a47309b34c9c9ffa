#include "service/shards/tasks.h"

#include <gtest/gtest.h>
#include <sched.h>

#include <atomic>
#include <cstddef>
#include <stdexcept>
#include <string>
#include <vector>

namespace curlew {
namespace {

TEST(Tasks, EachIsDoneOnce) {
  constexpr std::size_t kTasks = 1000;
  std::vector<std::atomic<int>> times(kTasks);
  Tasks tasks;
  for (std::size_t i = 0; i < kTasks; ++i) tasks.emplace_back([&times, i] { ++times[i]; });
  do_tasks(tasks);
  for (std::size_t i = 0; i < kTasks; ++i) EXPECT_EQ(times[i], 1) << i;
}

TEST(Tasks, NoneIsNothingToDo) { EXPECT_NO_THROW(do_tasks({})); }

TEST(Tasks, AFailureIsThrownWhenNoTaskRunsAnyMore) {
  std::atomic<int> running{0};
  std::atomic<bool> thrown{false};
  Tasks tasks(100, [&] {
    ++running;
    --running;
  });
  tasks[3] = [&] {
    thrown = true;
    throw std::runtime_error("the disk is full");
  };
  try {
    do_tasks(tasks);
    ADD_FAILURE() << "the failure was lost";
  } catch (const std::runtime_error& error) {
    EXPECT_EQ(std::string(error.what()), "the disk is full");
  }
  EXPECT_TRUE(thrown);
  EXPECT_EQ(running, 0);
}

/// Gives this thread one CPU, as a scheduler may, for as long as it lives.
class OneCpu {
 public:
  OneCpu() {
    sched_getaffinity(0, sizeof before_, &before_);
    cpu_set_t one;
    CPU_ZERO(&one);
    for (std::size_t cpu = 0; cpu < CPU_SETSIZE && CPU_COUNT(&one) == 0; ++cpu)
      if (CPU_ISSET(cpu, &before_)) CPU_SET(cpu, &one);
    sched_setaffinity(0, sizeof one, &one);
  }
  OneCpu(const OneCpu&) = delete;
  OneCpu& operator=(const OneCpu&) = delete;
  ~OneCpu() { sched_setaffinity(0, sizeof before_, &before_); }

 private:
  cpu_set_t before_{};
};

TEST(Tasks, OnOneCpuTheyAreDoneInTheirOrderUpToTheFirstFailure) {
  const OneCpu one_cpu;
  std::vector<int> done;
  Tasks tasks;
  for (int i = 0; i < 9; ++i)
    tasks.emplace_back([&done, i] {
      if (i == 5) throw std::runtime_error("damaged");
      done.push_back(i);
    });
  EXPECT_THROW(do_tasks(tasks), std::runtime_error);
  EXPECT_EQ(done, (std::vector{0, 1, 2, 3, 4}));
}

}  // namespace
}  // namespace curlew
