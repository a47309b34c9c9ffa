// The live path in one process: a camera that does not wait, the feed, and plans that change.
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cstring>
#include <thread>

#include "acquisition/drawn_loop.h"
#include "acquisition/paced_camera.h"
#include "acquisition/simulator/simulator.h"
#include "service/live_feed.h"
#include "service/pipeline.h"
#include "tests/support/exact_sensor.h"

namespace curlew {
namespace {

using std::chrono::milliseconds;

constexpr int kWindow = 8;

SimulatorOptions one_vortex() {
  SimulatorOptions options;
  options.rows = options.cols = 12;
  options.window_px = kWindow;
  options.frames = -1;
  options.scene.vortices = {{3.5, 4.5, 1}};
  options.scene.vortex_amplitude = VortexAmplitude::kLinearCore;
  options.scene.core_radius = 1.5;
  return options;
}

/// Gives the same frame over and over, `count` times or without end.
class SameFrame final : public FrameSource {
 public:
  explicit SameFrame(const SimulatorOptions& options, std::int64_t count = -1) : count_(count) {
    Simulator simulator(options);
    frame_ = std::make_unique<FrameBuffer>(simulator.format());
    simulator.next(*frame_);
  }
  const FrameFormat& format() const override { return frame_->format(); }
  std::int64_t frame_count() const override { return count_; }
  Delivery next(FrameBuffer& into) override {
    if (given_ == count_) return Delivery::kEnd;
    into.header = {.sequence = given_++, .received = std::chrono::steady_clock::now()};
    std::memcpy(into.data(), frame_->data(), format().bytes());
    into.rows_ready = format().rows;
    return Delivery::kFrame;
  }

 private:
  std::unique_ptr<FrameBuffer> frame_;
  std::int64_t count_;
  std::int64_t given_ = 0;
};

Config config_of(Threading threads) {
  Config config;
  config.pipeline.threads = threads;
  config.pipeline.slots = 3;
  return config;
}

class Live : public ::testing::TestWithParam<Threading> {
 protected:
  Live()
      : simulator_(one_vortex()),
        sensor_(sensor_of(simulator_, kWindow, 100.0)),
        config_(config_of(GetParam())),
        pipeline_(plan(config_), config_.pipeline) {}

  std::shared_ptr<const Plan> plan(const Config& config) const {
    return std::make_shared<const Plan>(sensor_, simulator_.format(), config);
  }
  std::unique_ptr<Camera> camera(double rate_hz, std::int64_t frames = -1) const {
    return make_paced_camera(std::make_unique<SameFrame>(one_vortex(), frames),
                             {.rate_hz = rate_hz, .readout_us = 0.0}, {"test", {}, {}}, {});
  }

  Simulator simulator_;
  Sensor sensor_;
  Config config_;
  Pipeline pipeline_;
  FeedControl control_;
};

// Ten frames come while one is worked on. The only memory is that of the buffers made at the start.
TEST_P(Live, ASlowConsumerGetsTheNewestFrameAndEveryDropIsCounted) {
  const auto source = camera(1000.0);
  const std::size_t in_pipeline = GetParam() == Threading::kInline ? 1 : config_.pipeline.slots;
  FrameExchange exchange(source->format(), in_pipeline + 4);
  LiveFeed feed(exchange, {.end_index = 60}, control_);
  std::int64_t sum_of_gaps = 0;
  std::int64_t last = -1;
  Publisher publisher;
  publisher.publish = [&](const FrameSlot& slot) {
    const std::int64_t sequence = slot.frame->header.sequence;
    ASSERT_GT(sequence, last);
    if (last >= 0) sum_of_gaps += sequence - last - 1;
    last = sequence;
    EXPECT_EQ(slot.vortices.size(), 1U);
    std::this_thread::sleep_for(milliseconds(10));
  };
  RunReport report;
  {
    const Streaming streaming(*source, exchange);
    report = pipeline_.run(feed, publisher);
  }
  EXPECT_EQ(feed.end(), LiveFeed::End::kLimit);
  EXPECT_EQ(report.frames, 60);
  EXPECT_EQ(source->counts().lost, 0) << "the camera must always have a buffer";
  EXPECT_EQ(source->counts().delivered, exchange.delivered());
  EXPECT_GT(exchange.superseded(), 60) << "the consumer must have been slow";
  const std::int64_t unprocessed = exchange.delivered() - exchange.superseded() - report.frames;
  EXPECT_TRUE(unprocessed == 0 || unprocessed == 1) << unprocessed;
  // The numbers that are missing are those of frames superseded before the last result.
  EXPECT_EQ(report.dropped, sum_of_gaps);
  EXPECT_LE(sum_of_gaps, exchange.superseded());
  // A frame waits for as many results as there are slots, and one more. Ten times that is a hang.
  EXPECT_LT(report.total.percentile_ns(0.5), 10 * 11'000'000 * static_cast<long>(in_pipeline + 1));
}

// Frames go out while a thread still draws others behind turbulence. The camera may stop and start
// meanwhile.
TEST_P(Live, ACameraSendsWhatIsDrawnAndStopsWhileMoreIsDrawn) {
  SimulatorOptions options = one_vortex();
  TurbulentPath path;
  path.screens = 2;
  path.grid = 64;
  path.grid_samples = 2;
  options.turbulence = path;
  auto loop = std::make_unique<DrawnLoop>(
      std::make_unique<Simulator>(options),
      DrawnLoop::Plan{.frames = 1000, .drawn_first = 1, .interval_ns = Simulator::kFramePeriodNs});
  const DrawnLoop& drawn = *loop;
  const auto source =
      make_paced_camera(std::move(loop), {.rate_hz = 2000.0}, {"turbulence", {}, {}}, {});
  std::int64_t frames = 0;
  for (int time = 0; time < 2; ++time) {
    FrameExchange exchange(source->format(), config_.pipeline.slots + 4);
    LiveFeed feed(exchange, {.end_index = 30}, control_);
    const Streaming streaming(*source, exchange);
    frames += pipeline_.run(feed, {}).frames;
  }
  EXPECT_EQ(frames, 60);
  EXPECT_EQ(source->failure(), "");
  EXPECT_LT(drawn.drawn(), 1000) << "the test must have been over before all was drawn";
}

// The camera is faster than its consumer, and ends: no frame is taken twice or lost uncounted.
TEST_P(Live, DeliveredIsResultsPlusSupersededPlusWhatWasLeft) {
  const auto source = camera(20000.0, 3000);
  FrameExchange exchange(source->format(), 8);
  LiveFeed feed(exchange, {}, control_);
  RunReport report;
  {
    const Streaming streaming(*source, exchange);
    report = pipeline_.run(feed, {});
  }
  EXPECT_EQ(feed.end(), LiveFeed::End::kClosed);
  EXPECT_EQ(source->failure(), "");
  const FrameCounts counts = source->counts();
  EXPECT_EQ(counts.delivered + counts.lost, 3000);
  EXPECT_EQ(counts.delivered, report.frames + exchange.superseded())
      << "the last frame is never superseded and is taken after the end";
}

TEST_P(Live, EndsWhereNoFrameComes) {
  FrameExchange exchange(simulator_.format(), 8);
  LiveFeed feed(exchange, {.timeout_s = 0.1}, control_);
  EXPECT_EQ(pipeline_.run(feed, {}).frames, 0);
  EXPECT_EQ(feed.end(), LiveFeed::End::kTimedOut);
}

TEST_P(Live, StopsWhenAskedTo) {
  const auto source = camera(1000.0);
  FrameExchange exchange(source->format(), 8);
  LiveFeed feed(exchange, {}, control_);
  std::thread stopper([&] {
    std::this_thread::sleep_for(milliseconds(50));
    control_.stop = true;
  });
  {
    const Streaming streaming(*source, exchange);
    pipeline_.run(feed, {});
  }
  stopper.join();
  EXPECT_EQ(feed.end(), LiveFeed::End::kStopped);
}

// New plans arrive as fast as they are taken up, while frames stream. Every result belongs wholly
// to one plan, and no frame is lost for it.
TEST_P(Live, PlansChangeBetweenFrames) {
  Config blind = config_;
  blind.detect.min_circulation_rad = 99.0;
  const auto sees = plan(config_);
  const auto sees_not = plan(blind);
  const auto source = camera(2000.0);
  FrameExchange exchange(source->format(), config_.pipeline.slots + 4);
  LiveFeed feed(exchange, {}, control_);
  std::int64_t with = 0;
  std::int64_t without = 0;
  std::int64_t changes = 0;
  const Plan* last = nullptr;
  Publisher publisher;
  publisher.publish = [&](const FrameSlot& slot) {
    changes += std::exchange(last, slot.plan) != slot.plan ? 1 : 0;
    const bool blinded = slot.plan == sees_not.get();
    EXPECT_EQ(slot.vortices.size(), blinded ? 0U : 1U);
    ++(blinded ? without : with);
  };
  std::thread reloading([&] {
    for (int taken_up = 0; taken_up < 40;) {
      if (pipeline_.adopt(taken_up % 2 == 0 ? sees_not : sees)) ++taken_up;
      std::this_thread::sleep_for(milliseconds(1));
    }
    control_.stop = true;
  });
  RunReport report;
  {
    const Streaming streaming(*source, exchange);
    report = pipeline_.run(feed, publisher);
  }
  reloading.join();
  EXPECT_GT(with, 0);
  EXPECT_GT(without, 0);
  EXPECT_GE(changes, 20) << "the plans must have changed often";
  EXPECT_EQ(source->counts().lost, 0);
  const std::int64_t unprocessed = exchange.delivered() - exchange.superseded() - report.frames;
  EXPECT_TRUE(unprocessed == 0 || unprocessed == 1) << unprocessed;
}

TEST_P(Live, APlanGivenBetweenRunsIsTakenUpAtOnce) {
  Config blind = config_;
  blind.detect.min_circulation_rad = 99.0;
  ASSERT_TRUE(pipeline_.adopt(plan(blind)));
  SameFrame source(one_vortex(), 5);
  RecordedFeed feed(source, {});
  EXPECT_EQ(pipeline_.run(feed, {}).vortices, 0);
  ASSERT_TRUE(pipeline_.adopt(plan(config_)));
  SameFrame again(one_vortex(), 5);
  RecordedFeed second(again, {});
  EXPECT_EQ(pipeline_.run(second, {}).vortices, 5);
}

TEST_P(Live, MissedDeadlinesAreCountedAndMarked) {
  for (const double deadline_us : {0.001, 60e6}) {
    config_.pipeline.deadline_us = deadline_us;
    Pipeline pipeline(plan(config_), config_.pipeline);
    SameFrame source(one_vortex(), 20);
    RecordedFeed feed(source, {});
    std::int64_t marked = 0;
    Publisher publisher;
    publisher.publish = [&](const FrameSlot& slot) {
      marked += (slot.frame->header.status & kFrameLate) != 0 ? 1 : 0;
    };
    const RunReport report = pipeline.run(feed, publisher);
    EXPECT_EQ(report.late, marked);
    EXPECT_EQ(report.late, deadline_us < 1.0 ? 20 : 0) << deadline_us;
  }
}

/// Says that its frames were received 5 ms ago.
class OldFrames final : public FrameSource {
 public:
  explicit OldFrames(FrameSource& frames) : frames_(frames) {}
  const FrameFormat& format() const override { return frames_.format(); }
  std::int64_t frame_count() const override { return frames_.frame_count(); }
  Delivery next(FrameBuffer& into) override {
    const Delivery delivery = frames_.next(into);
    into.header.received -= milliseconds(5);
    return delivery;
  }

 private:
  FrameSource& frames_;
};

// The deadline is in microseconds: after 5 ms a result is late for a deadline of 1000 µs.
TEST_P(Live, TheDeadlineIsInMicroseconds) {
  config_.pipeline.deadline_us = 1000.0;
  Pipeline pipeline(plan(config_), config_.pipeline);
  SameFrame frames(one_vortex(), 20);
  OldFrames source(frames);
  RecordedFeed feed(source, {});
  const RunReport report = pipeline.run(feed, {});
  EXPECT_EQ(report.frames, 20);
  EXPECT_EQ(report.late, 20);
}

INSTANTIATE_TEST_SUITE_P(Modes, Live, ::testing::Values(Threading::kInline, Threading::kTeam),
                         [](const auto& mode) {
                           return std::string(mode.param == Threading::kInline ? "inline" : "team");
                         });

}  // namespace
}  // namespace curlew
