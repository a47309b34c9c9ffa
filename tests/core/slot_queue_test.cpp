#include "core/slot_queue.h"

#include <gtest/gtest.h>

#include <thread>
#include <vector>

namespace curlew {
namespace {

TEST(SlotQueue, KeepsOrderAcrossThreadsAndReportsTheEnd) {
  constexpr int kCount = 200000;
  std::vector<int> slots(8);
  SlotQueue<int> forward(slots.size());
  SlotQueue<int> back(slots.size());
  for (int& slot : slots) back.push(&slot);
  std::thread producer([&] {
    int* slot = nullptr;
    for (int i = 0; i < kCount && back.pop(slot); ++i) {
      *slot = i;
      forward.push(slot);
    }
    forward.close();
  });
  int expected = 0;
  int* slot = nullptr;
  while (forward.pop(slot)) {
    ASSERT_EQ(*slot, expected);
    ++expected;
    back.push(slot);
  }
  producer.join();
  EXPECT_EQ(expected, kCount);
  EXPECT_FALSE(forward.pop(slot));  // The end must stay the end.
}

TEST(SlotQueue, WakesAParkedConsumer) {
  int value = 0;
  SlotQueue<int> queue(1);
  std::thread consumer([&] {
    int* slot = nullptr;
    if (queue.pop(slot)) *slot = 7;
  });
  std::this_thread::sleep_for(std::chrono::milliseconds(30));  // This is well past the spin.
  queue.push(&value);
  consumer.join();
  EXPECT_EQ(value, 7);
}

}  // namespace
}  // namespace curlew
