#include "core/frame_exchange.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cstring>
#include <set>
#include <thread>

namespace curlew {
namespace {

constexpr std::int64_t kLongUs = 5'000'000;

FrameFormat small() { return {.rows = 2, .cols = 4, .pixel_type = PixelType::kU16}; }

TEST(FrameExchange, GivesEveryBufferOnceAndThenNone) {
  FrameExchange exchange(small(), 5);
  std::set<FrameBuffer*> seen;
  while (FrameBuffer* buffer = exchange.empty()) seen.insert(buffer);
  EXPECT_EQ(seen.size(), 5U);
  EXPECT_EQ(exchange.empty(), nullptr);
  exchange.give_back(*seen.begin());
  EXPECT_EQ(exchange.empty(), *seen.begin());
}

TEST(FrameExchange, TheNewestFrameIsTakenAndTheOneBeforeComesBack) {
  FrameExchange exchange(small(), 3);
  FrameBuffer* first = exchange.empty();
  FrameBuffer* second = exchange.empty();
  EXPECT_EQ(exchange.take(0), nullptr);
  EXPECT_EQ(exchange.deliver(first), nullptr);
  EXPECT_EQ(exchange.deliver(second), first)
      << "deliver() must return the superseded frame's buffer, to be filled again";
  EXPECT_EQ(exchange.take(kLongUs), second);
  EXPECT_EQ(exchange.take(0), nullptr) << "a frame must be taken only once";
  EXPECT_EQ(exchange.delivered(), 2);
  EXPECT_EQ(exchange.superseded(), 1);
}

TEST(FrameExchange, WhatWaitsWhenItClosesIsStillTaken) {
  FrameExchange exchange(small(), 3);
  FrameBuffer* frame = exchange.empty();
  exchange.deliver(frame);
  exchange.close();
  EXPECT_EQ(exchange.take(kLongUs), frame);
  EXPECT_EQ(exchange.take(kLongUs), nullptr);
  EXPECT_EQ(exchange.take(kLongUs), nullptr) << "take() must not wait once the exchange is closed";
}

TEST(FrameExchange, ClosingEndsAWait) {
  FrameExchange exchange(small(), 3);
  std::thread closer([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    exchange.close();
  });
  EXPECT_EQ(exchange.take(60'000'000), nullptr);
  closer.join();
}

// Here the camera never waits and the consumer dawdles now and then. Every frame must be either
// taken or superseded, in order and whole, and the camera must never run out of buffers.
TEST(FrameExchange, NothingIsLostOrTornBetweenThreads) {
  constexpr std::int64_t kFrames = 20'000;
  FrameExchange exchange(small(), 4);  // One is taken, one waits, two are being filled.
  std::int64_t starved = 0;
  std::thread camera([&] {
    FrameBuffer* buffer = exchange.empty();
    for (std::int64_t i = 0; i < kFrames; ++i) {
      if (buffer == nullptr) buffer = exchange.empty();
      if (buffer == nullptr) {
        ++starved;
        continue;
      }
      std::memset(buffer->data(), static_cast<int>(i & 0xff), buffer->format().bytes());
      buffer->header.sequence = i;
      buffer = exchange.deliver(buffer);
    }
    exchange.close();
  });
  std::int64_t taken = 0;
  std::int64_t last = -1;
  while (true) {
    FrameBuffer* frame = exchange.take(kLongUs);
    if (frame == nullptr) break;
    ++taken;
    ASSERT_GT(frame->header.sequence, last) << "a frame must never come after a newer one";
    last = frame->header.sequence;
    const auto* bytes = frame->view().data<unsigned char>();
    for (std::size_t b = 0; b < frame->format().bytes(); ++b)
      ASSERT_EQ(bytes[b], static_cast<unsigned char>(last & 0xff)) << "frame " << last;
    if (taken % 7 == 0) std::this_thread::sleep_for(std::chrono::microseconds(100));
    exchange.give_back(frame);
  }
  camera.join();
  EXPECT_EQ(starved, 0);
  EXPECT_EQ(last, kFrames - 1) << "the last frame has no successor that could supersede it";
  EXPECT_EQ(exchange.delivered(), kFrames);
  EXPECT_EQ(taken + exchange.superseded(), kFrames);
}

}  // namespace
}  // namespace curlew
