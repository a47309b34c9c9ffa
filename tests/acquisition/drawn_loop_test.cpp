#include "acquisition/drawn_loop.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <limits>
#include <semaphore>
#include <thread>

#include "acquisition/paced_camera.h"
#include "core/error.h"
#include "tests/support/failure_text.h"

namespace curlew {
namespace {

using std::chrono::milliseconds;

constexpr std::int64_t kIntervalNs = 20'000;

/// What the test sees and does while a source draws.
struct Easel {
  std::counting_semaphore<> permits{0};  ///< of frames that may be drawn
  std::atomic<int> drawn{0};
};

/// Draws frames of one pixel, the frame's number, each when it is permitted. It ends, or fails, at
/// a number.
class SlowSource final : public FrameSource {
 public:
  SlowSource(Easel& easel, int end, int failing = std::numeric_limits<int>::max())
      : easel_(easel), end_(end), failing_(failing) {}

  const FrameFormat& format() const override { return format_; }
  std::int64_t frame_count() const override { return end_; }
  Delivery next(FrameBuffer& into) override {
    easel_.permits.acquire();
    if (easel_.drawn == failing_) throw Failure("the easel fell over");
    if (easel_.drawn == end_) return Delivery::kEnd;
    into.data()[0] = static_cast<std::byte>(easel_.drawn++);
    return Delivery::kFrame;
  }

 private:
  FrameFormat format_{.rows = 1, .cols = 1, .pixel_type = PixelType::kU8};
  Easel& easel_;
  int end_;
  int failing_;
};

/// Expects the next frame to be the k-th that is sent, with this picture.
void expect_next(DrawnLoop& loop, FrameBuffer& into, std::int64_t k, std::int64_t picture) {
  ASSERT_EQ(loop.next(into), Delivery::kFrame);
  EXPECT_EQ(into.header.sequence, k);
  EXPECT_EQ(into.header.camera_ns, k * kIntervalNs);
  EXPECT_EQ(static_cast<int>(into.data()[0]), picture);
  EXPECT_EQ(into.rows_ready, 1);
}

void wait_for(const std::function<bool()>& condition) {
  while (!condition()) std::this_thread::sleep_for(milliseconds(1));
}

TEST(DrawnLoop, FramesComeBeforeAllAreDrawnAndInTheEndAllCome) {
  Easel easel;
  easel.permits.release(1);
  DrawnLoop loop(std::make_unique<SlowSource>(easel, 100),
                 {.frames = 3, .drawn_first = 1, .interval_ns = kIntervalNs});
  FrameBuffer into(loop.format());
  std::int64_t k = 0;
  for (; k < 5; ++k) expect_next(loop, into, k, 0);
  easel.permits.release(1);
  wait_for([&] { return loop.drawn() == 2; });
  for (; k < 10; ++k) expect_next(loop, into, k, k % 2);
  easel.permits.release(100);
  wait_for([&] { return loop.drawn() == 3; });
  for (; k < 20; ++k) expect_next(loop, into, k, k % 3);
  EXPECT_EQ(easel.drawn, 3);
}

TEST(DrawnLoop, WhatIsDrawnFirstIsThereAtOnce) {
  Easel easel;
  easel.permits.release(4);
  DrawnLoop loop(std::make_unique<SlowSource>(easel, 100),
                 {.frames = 4, .drawn_first = 4, .interval_ns = kIntervalNs});
  FrameBuffer into(loop.format());
  for (std::int64_t k = 0; k < 9; ++k) expect_next(loop, into, k, k % 4);
}

TEST(DrawnLoop, ASourceThatEndsEarlyMakesAShorterLoopAndAnEmptyOneNone) {
  Easel easel;
  easel.permits.release(100);
  DrawnLoop loop(std::make_unique<SlowSource>(easel, 2),
                 {.frames = 5, .drawn_first = 5, .interval_ns = kIntervalNs});
  FrameBuffer into(loop.format());
  for (std::int64_t k = 0; k < 6; ++k) expect_next(loop, into, k, k % 2);
  Easel empty;
  empty.permits.release(1);
  EXPECT_NE(failure_text([&] {
              DrawnLoop none(std::make_unique<SlowSource>(empty, 0), {});
            }).find("there is no frame"),
            std::string::npos);
}

TEST(DrawnLoop, TheEndWaitsForTheFrameThatIsDrawnAndForNoOther) {
  Easel easel;
  constexpr int kMany = 100'000;
  easel.permits.release(kMany);
  {
    const DrawnLoop loop(std::make_unique<SlowSource>(easel, kMany),
                         {.frames = kMany, .drawn_first = 1, .interval_ns = kIntervalNs});
    wait_for([&] { return loop.drawn() > 1; });
  }
  EXPECT_LT(easel.drawn, kMany);
}

// The camera goes on with what is drawn, stops at once although a frame is being drawn, and says
// why it ended.
TEST(DrawnLoop, ACameraTellsThatDrawingFailed) {
  Easel easel;
  easel.permits.release(1);
  auto loop = std::make_unique<DrawnLoop>(
      std::make_unique<SlowSource>(easel, 100, 2),
      DrawnLoop::Plan{.frames = 5, .drawn_first = 1, .interval_ns = kIntervalNs});
  const FrameFormat format = loop->format();
  const auto camera =
      make_paced_camera(std::move(loop), {.rate_hz = 1000.0}, {"an easel", {}, {}}, {});
  {
    FrameExchange exchange(format, 4);
    const Streaming streaming(*camera, exchange);
    wait_for([&] { return camera->counts().delivered > 2; });
  }
  EXPECT_EQ(easel.drawn, 1) << "the camera must have stopped while the second frame was drawn";
  EXPECT_EQ(camera->failure(), "");
  FrameExchange exchange(format, 4);
  const Streaming streaming(*camera, exchange);
  easel.permits.release(2);
  wait_for([&] { return !camera->failure().empty(); });
  EXPECT_EQ(camera->failure(), "the easel fell over");
}

}  // namespace
}  // namespace curlew
