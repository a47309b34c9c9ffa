#include "core/side_queue.h"

#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <thread>

namespace curlew {
namespace {

struct Note {
  std::int64_t number = 0;
};

SideQueue<Note> queue_of(std::size_t items) {
  return {items, [] { return std::make_unique<Note>(); }};
}

TEST(SideQueue, AFullPoolRefusesAndCounts) {
  auto queue = queue_of(2);
  Note* first = queue.claim();
  Note* second = queue.claim();
  ASSERT_NE(first, nullptr);
  ASSERT_NE(second, nullptr);
  EXPECT_EQ(queue.claim(), nullptr);
  EXPECT_EQ(queue.dropped(), 1);
  queue.send(first);
  Note* taken = nullptr;
  ASSERT_TRUE(queue.take(taken));
  EXPECT_EQ(taken, first);
  queue.give_back(taken);
  EXPECT_EQ(queue.claim(), first);
}

TEST(SideQueue, DrainsAfterItIsClosed) {
  auto queue = queue_of(3);
  Note* note = queue.claim();
  queue.send(note);
  queue.close();
  EXPECT_FALSE(queue.ended());
  Note* taken = nullptr;
  EXPECT_TRUE(queue.take(taken));
  EXPECT_FALSE(queue.take(taken));
  EXPECT_TRUE(queue.ended());
  EXPECT_FALSE(queue.take_for(taken, 0));
}

TEST(SideQueue, TakesInOrderAndEveryNoteIsTakenOrDropped) {
  constexpr std::int64_t kNotes = 20'000;
  auto queue = queue_of(8);
  std::thread producer([&] {
    for (std::int64_t i = 0; i < kNotes; ++i)
      if (Note* note = queue.claim()) {
        note->number = i;
        queue.send(note);
      }
    queue.close();
  });
  std::int64_t taken = 0;
  std::int64_t last = -1;
  Note* note = nullptr;
  while (queue.take(note)) {
    EXPECT_GT(note->number, last);
    last = note->number;
    if (++taken % 100 == 0) std::this_thread::sleep_for(std::chrono::microseconds(100));
    queue.give_back(note);
  }
  producer.join();
  EXPECT_EQ(taken + queue.dropped(), kNotes);
}

}  // namespace
}  // namespace curlew
