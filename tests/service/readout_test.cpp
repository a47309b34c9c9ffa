// Frames that are worked on while they are read out give the results of whole frames.
#include "core/readout.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <functional>
#include <memory>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "acquisition/paced_camera.h"
#include "acquisition/simulator/simulator.h"
#include "core/error.h"
#include "service/live_feed.h"
#include "service/pipeline.h"
#include "tests/support/exact_sensor.h"
#include "tests/support/failure_text.h"
#include "tests/support/result_bytes.h"

namespace curlew {
namespace {

constexpr int kWindow = 8;
constexpr std::int64_t kFrames = 60;

SimulatorOptions scene() {
  SimulatorOptions options;
  options.rows = options.cols = 14;
  options.window_px = kWindow;
  options.pupil = PupilShape::kObscured;
  options.field_samples = 16;
  options.photons = 1000.0;
  options.read_noise_e = 4.0;
  options.frames = kFrames;
  options.seed = 11;
  options.scene.vortices = {{3.2, 4.6, 1}, {8.1, 6.7, -1}};
  options.scene.velocity_x = 0.01;
  return options;
}

/// Frames in which all happens that may make the rows before the last ones useless: the pattern
/// wanders and steps, cosmic rays hit, the noise and the level jump, and light fails.
std::vector<std::shared_ptr<FrameBuffer>> eventful_frames(Simulator& simulator) {
  std::vector<std::shared_ptr<FrameBuffer>> frames;
  std::mt19937 random(5);
  for (std::int64_t i = 0; i < kFrames; ++i) {
    auto frame = std::make_shared<FrameBuffer>(simulator.format());
    EXPECT_EQ(simulator.next(*frame), Delivery::kFrame);
    auto* pixels = reinterpret_cast<std::uint16_t*>(frame->data());
    const auto cols = static_cast<std::ptrdiff_t>(simulator.format().cols);
    const auto n = static_cast<std::ptrdiff_t>(simulator.format().pixels());
    const std::ptrdiff_t shift = i / 12 + (i >= 40 ? kWindow * cols : 0);
    std::move_backward(pixels, pixels + (n - shift), pixels + n);
    std::uniform_int_distribution<std::ptrdiff_t> anywhere(0, n - 1);
    for (int hit = 0; hit < 6; ++hit) pixels[anywhere(random)] = 6000;
    std::normal_distribution<float> noise(i >= 20 ? 30.0F : 0.0F, i >= 20 && i < 30 ? 15.0F : 1.0F);
    for (std::ptrdiff_t k = 0; k < n; ++k) {
      const float value = static_cast<float>(pixels[k]) + noise(random);
      pixels[k] = static_cast<std::uint16_t>(std::clamp(value, 0.0F, 65535.0F));
    }
    if (i >= 50 && i < 53) std::fill_n(pixels, n, std::uint16_t{100});
    frames.push_back(std::move(frame));
  }
  return frames;
}

/// Hands frames on whole, or as a camera does that reads them out row by row. Every fifth readout
/// breaks off if that is asked for; the frame then comes again.
class ReadoutFeed final : public Feed {
 public:
  ReadoutFeed(const std::vector<std::shared_ptr<FrameBuffer>>& frames, bool streamed, bool breaks)
      : frames_(frames), streamed_(streamed), breaks_(breaks) {}
  ~ReadoutFeed() override { join(); }
  ReadoutFeed(const ReadoutFeed&) = delete;
  ReadoutFeed& operator=(const ReadoutFeed&) = delete;

  bool fill(FrameSlot& slot) override {
    join();
    if (next_ == frames_.size()) return false;
    const FrameBuffer& from = *frames_[next_];
    if (slot.frame == nullptr) {
      buffers_.push_back(std::make_unique<FrameBuffer>(from.format()));
      slot.frame = buffers_.back().get();
    }
    slot.frame_index = static_cast<std::int64_t>(next_);
    FrameBuffer* to = slot.frame;
    const bool breaks = breaks_ && ++readouts_ % 5 == 0;
    if (!breaks) ++next_;
    to->header = from.header;
    const int rows = from.format().rows;
    std::vector<int> steps;
    std::uniform_int_distribution<int> step(1, 24);
    for (int ready = streamed_ ? step(random_) : rows; ready < rows; ready += step(random_))
      steps.push_back(ready);
    if (breaks) steps.resize(steps.size() / 2 + 1);
    steps.push_back(breaks ? kReadoutBrokeOff : rows);
    const auto copy = [&from, to](int first, int last) {
      const std::size_t row = from.format().bytes() / static_cast<std::size_t>(from.format().rows);
      std::copy_n(from.view().pixels + static_cast<std::size_t>(first) * row,
                  static_cast<std::size_t>(last - first) * row,
                  to->data() + static_cast<std::size_t>(first) * row);
    };
    copy(0, steps.front());
    to->rows_ready = steps.front();
    camera_ = std::thread([steps, copy, to] {
      for (std::size_t i = 1; i < steps.size(); ++i) {
        if (steps[i] == kReadoutBrokeOff) return break_off(*to);
        copy(steps[i - 1], steps[i]);
        announce_rows(*to, steps[i]);
      }
    });
    return true;
  }
  void release(FrameSlot& slot) noexcept override {
    if (slot.broke_off) ++broke_off;
  }

  std::atomic<int> broke_off{0};

 private:
  void join() {
    if (camera_.joinable()) camera_.join();
  }

  const std::vector<std::shared_ptr<FrameBuffer>>& frames_;
  bool streamed_;
  bool breaks_;
  std::size_t next_ = 0;
  int readouts_ = 0;
  std::mt19937 random_{3};
  std::vector<std::unique_ptr<FrameBuffer>> buffers_;
  std::thread camera_;
};

struct Collected {
  std::vector<std::string> frames;
  RunReport report;
  int broke_off = 0;
};

using Change = std::function<void(Config&)>;

class StreamedFrames : public ::testing::Test {
 protected:
  StreamedFrames()
      : simulator_(scene()),
        sensor_(sensor_of(simulator_, kWindow, 100.0)),
        frames_(eventful_frames(simulator_)) {}

  Collected run(Threading threads, bool streamed, bool breaks, const Change& change = {}) {
    Config config;
    config.centroid.measure_ahead = true;
    config.detect.method = DetectMethod::kCirculation;
    config.pipeline.threads = threads;
    config.pipeline.slots = 3;
    if (change) change(config);
    Pipeline pipeline(std::make_shared<const Plan>(sensor_, simulator_.format(), config),
                      config.pipeline);
    ReadoutFeed feed(frames_, streamed, breaks);
    Collected collected;
    Publisher publisher;
    publisher.publish = [&](const FrameSlot& slot) {
      collected.frames.push_back(result_bytes(slot));
    };
    collected.report = pipeline.run(feed, publisher);
    collected.broke_off = feed.broke_off;
    return collected;
  }

  void expect_same(const Collected& whole, const Collected& streamed) {
    ASSERT_EQ(whole.frames.size(), frames_.size());
    ASSERT_EQ(streamed.frames.size(), frames_.size());
    for (std::size_t i = 0; i < frames_.size(); ++i)
      ASSERT_TRUE(whole.frames[i] == streamed.frames[i]) << "frame " << i;
    EXPECT_EQ(whole.report.followed, streamed.report.followed);
    EXPECT_EQ(whole.report.vortices, streamed.report.vortices);
  }

  Simulator simulator_;
  Sensor sensor_;
  std::vector<std::shared_ptr<FrameBuffer>> frames_;
};

TEST_F(StreamedFrames, GiveTheBitsOfWholeFramesInlineAndThreaded) {
  const Collected whole = run(Threading::kInline, false, false);
  const auto frames = [&](FollowState state) {
    return whole.report.followed[static_cast<std::size_t>(state)];
  };
  EXPECT_GT(frames(FollowState::kSettled), 20);
  EXPECT_GT(frames(FollowState::kMoved) + frames(FollowState::kAcquired), 1);
  EXPECT_GT(frames(FollowState::kNoLight), 0);
  EXPECT_GT(whole.report.vortices, kFrames / 2);
  expect_same(whole, run(Threading::kInline, true, false));
  expect_same(whole, run(Threading::kTeam, true, false));
}

TEST_F(StreamedFrames, FramesThatBreakOffLeaveNoTrace) {
  const Collected whole = run(Threading::kInline, false, false);
  for (const Threading threads : {Threading::kInline, Threading::kTeam}) {
    const Collected broken = run(threads, true, true);
    EXPECT_GT(broken.broke_off, 10);
    EXPECT_EQ(broken.report.frames, kFrames);
    expect_same(whole, broken);
  }
}

TEST_F(StreamedFrames, AlsoWhereWindowsOrLevelStay) {
  for (const Change& change : {Change([](Config& c) { c.centroid.follow_windows = false; }),
                               Change([](Config& c) { c.centroid.follow_level = false; })}) {
    const Collected whole = run(Threading::kInline, false, false, change);
    expect_same(whole, run(Threading::kInline, true, false, change));
    expect_same(whole, run(Threading::kInline, true, true, change));
  }
}

TEST_F(StreamedFrames, MostOfThemIsMeasuredBeforeTheLastRow) {
  Config config;
  config.centroid.measure_ahead = true;
  config.detect.method = DetectMethod::kCirculation;
  const Plan plan(sensor_, simulator_.format(), config);
  WindowFollower follower(*plan.follower);
  FrameSlot slot(plan, &follower);
  slot.frame = frames_[0].get();
  kStages[0].run(plan, slot);
  // A row of lenslets of the frame before is wiped out. Those that the first rows show come back.
  slot.frame = frames_[1].get();
  slot.centroids.flux_adu.fill(-1.0F);
  measure_ahead(plan, slot, 9 * kWindow);
  int measured = 0;
  for (int r = 0; r < 14; ++r) measured += slot.centroids.flux_adu(r, 7) >= 0.0F ? 1 : 0;
  EXPECT_GE(measured, 4);
  EXPECT_LE(measured, 9);
  kStages[0].run(plan, slot);
  EXPECT_GE(*std::min_element(slot.centroids.flux_adu.begin(), slot.centroids.flux_adu.end()),
            0.0F);
}

TEST(RollingReadout, TheCameraHandsFramesOnRowByRow) {
  Simulator simulator(scene());
  const FrameFormat format = simulator.format();
  auto source = std::make_unique<Simulator>(scene());
  const auto camera = make_paced_camera(std::move(source), {.rate_hz = 40.0, .readout_us = 20'000},
                                        {"test", {}, {}}, {});
  FrameExchange exchange(format, 6);
  FrameBuffer expected(format);
  // On a busy machine a frame may be whole before its first rows are looked at.
  constexpr int kPatience = 40;
  int taken = 0, most_steps = 0;
  {
    const Streaming streaming(*camera, exchange);
    while (taken < 4 || (most_steps <= 3 && taken < kPatience)) {
      FrameBuffer* frame = exchange.take(1'000'000);
      ASSERT_NE(frame, nullptr);
      int ready = frame->rows_ready;
      int steps = 0;
      while (ready != kReadoutBrokeOff && ready < format.rows) {
        const int more = wait_for_rows(*frame, ready);
        ASSERT_GT(more, ready);
        ready = more;
        ++steps;
      }
      ASSERT_EQ(ready, format.rows);
      most_steps = std::max(most_steps, steps);
      do {
        ASSERT_EQ(simulator.next(expected), Delivery::kFrame);
      } while (expected.header.sequence < frame->header.sequence);
      EXPECT_EQ(std::memcmp(expected.data(), frame->data(), format.bytes()), 0);
      exchange.give_back(frame);
      ++taken;
    }
  }
  EXPECT_GT(most_steps, 3);
  const FrameCounts counts = camera->counts();
  EXPECT_EQ(counts.delivered, exchange.delivered());
  EXPECT_LE(counts.aborted, 1);
}

TEST(RollingReadout, AStopInTheMiddleBreaksTheFrameOff) {
  auto source = std::make_unique<Simulator>(scene());
  const FrameFormat format = source->format();
  const auto camera = make_paced_camera(std::move(source), {.rate_hz = 1.0, .readout_us = 900'000},
                                        {"test", {}, {}}, {});
  FrameExchange exchange(format, 4);
  camera->start(exchange);
  FrameBuffer* frame = exchange.take(2'000'000);
  ASSERT_NE(frame, nullptr);
  camera->stop();
  EXPECT_EQ(frame->rows_ready, kReadoutBrokeOff);
  EXPECT_EQ(camera->counts().aborted, 1);
  EXPECT_EQ(camera->counts().delivered, 0);
  EXPECT_EQ(exchange.delivered(), 0);
}

TEST(RollingReadout, AReadoutLongerThanAPeriodIsRefused) {
  const std::string text = failure_text<UsageError>([] {
    make_paced_camera(std::make_unique<Simulator>(scene()), {.rate_hz = 1000.0, .readout_us = 2000},
                      {"test", {}, {}}, {});
  });
  EXPECT_NE(text.find("camera.readout_us"), std::string::npos) << text;
}

}  // namespace
}  // namespace curlew
