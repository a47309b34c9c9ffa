#include "acquisition/loop_source.h"

#include <gtest/gtest.h>

namespace curlew {
namespace {

LoopSource::Frames three_frames() {
  LoopSource::Frames frames;
  for (int i = 0; i < 3; ++i) {
    auto frame = std::make_shared<FrameBuffer>(FrameFormat{.rows = 2, .cols = 3});
    frame->data()[0] = static_cast<std::byte>(i);
    frame->header.camera_ns = 1000 + 10 * i;
    frames.push_back(std::move(frame));
  }
  return frames;
}

TEST(LoopSource, NumbersAndTheCamerasClockGoOnFromLapToLap) {
  LoopSource source(three_frames(), 8);
  FrameBuffer into(source.format());
  for (int i = 0; i < 8; ++i) {
    ASSERT_EQ(source.next(into), Delivery::kFrame);
    EXPECT_EQ(into.header.sequence, i);
    EXPECT_EQ(into.header.camera_ns, 1000 + 10 * i);
    EXPECT_EQ(static_cast<int>(into.data()[0]), i % 3);
    EXPECT_EQ(into.rows_ready, 2);
  }
  EXPECT_EQ(source.next(into), Delivery::kEnd);
}

}  // namespace
}  // namespace curlew
