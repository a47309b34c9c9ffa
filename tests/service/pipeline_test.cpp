#include "service/pipeline.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstring>
#include <functional>
#include <set>
#include <stdexcept>
#include <thread>

#include "acquisition/simulator/simulator.h"
#include "core/error.h"
#include "tests/support/exact_sensor.h"
#include "tests/support/sanitized.h"

namespace curlew {
namespace {

constexpr int kPipelineWindow = 8;
constexpr std::int64_t kPipelineFrames = kSanitized ? 80 : 200;

SimulatorOptions moving_vortices(std::int64_t frames, int window_px = kPipelineWindow) {
  SimulatorOptions options;
  options.rows = options.cols = 12;
  options.window_px = window_px;
  options.pupil = PupilShape::kObscured;
  options.field_samples = 16;
  options.photons = 2000.0;
  options.frames = frames;
  options.seed = 7301;
  options.scene.vortices = {{3.2, 4.6, 1}, {8.1, 6.7, -1}};
  options.scene.vortex_amplitude = VortexAmplitude::kLinearCore;
  options.scene.core_radius = 1.5;
  options.scene.velocity_x = 0.01;
  return options;
}

/// Returns everything that a frame gives, as bytes.
std::string bytes_of(const FrameSlot& slot) {
  std::string bytes;
  const auto add = [&](const void* data, std::size_t size) {
    bytes.append(static_cast<const char*>(data), size);
  };
  const auto add_image = [&](const Image<float>& image) {
    add(image.data(), image.size() * sizeof(float));
  };
  add(&slot.frame_index, sizeof slot.frame_index);
  add(&slot.frame->header.sequence, sizeof slot.frame->header.sequence);
  add(&slot.frame->header.status, sizeof slot.frame->header.status);
  for (const Vortex& v : slot.vortices) add(&v, sizeof v);
  for (const Image<float>* image :
       {&slot.slopes.x, &slot.slopes.y, &slot.slopes.variance_x, &slot.centroids.flux_adu,
        &slot.circulation.value, &slot.split.phase, &slot.split.solenoidal_x,
        &slot.split.potential})
    add_image(*image);
  add_image(slot.whole_phase);
  for (const HoleCirculation& hole : slot.split.holes) add(&hole.circulation, sizeof(float));
  return bytes;
}

struct Collected {
  std::vector<std::string> frames;
  std::set<std::int64_t> tracks;
  int reloads = 0;
  RunReport report;
};

/// The simulator's frames, moved by a pixel more every eight frames; for a while there is no light.
class WanderingSource final : public FrameSource {
 public:
  static constexpr std::int64_t kDarkFrom = 60;
  static constexpr std::int64_t kDarkTo = 70;
  explicit WanderingSource(Simulator& simulator) : simulator_(simulator) {}
  const FrameFormat& format() const override { return simulator_.format(); }
  std::int64_t frame_count() const override { return simulator_.frame_count(); }
  Delivery next(FrameBuffer& into) override {
    if (simulator_.next(into) != Delivery::kFrame) return Delivery::kEnd;
    constexpr std::uint16_t kDark = 100;
    constexpr std::int64_t kFramesAPixel = 8;
    const bool dark = next_ >= kDarkFrom && next_ < kDarkTo;
    const auto cols = static_cast<std::ptrdiff_t>(format().cols);
    const std::ptrdiff_t shift = dark ? cols : std::min(next_ / kFramesAPixel, cols);
    auto* pixels = reinterpret_cast<std::uint16_t*>(into.data());
    for (int row = 0; row < format().rows; ++row, pixels += cols) {
      std::move_backward(pixels, pixels + (cols - shift), pixels + cols);
      std::fill_n(pixels, shift, kDark);
    }
    ++next_;
    return Delivery::kFrame;
  }

 private:
  Simulator& simulator_;
  std::int64_t next_ = 0;
};

/// What is done to the configuration every ten frames, when the pipeline gets a new plan.
using Reload = std::function<void(Config&)>;

Collected run(Threading threads, std::size_t slots, DetectMethod method, bool wandering = false,
              const Reload& reload = {}) {
  Simulator simulator(moving_vortices(kPipelineFrames));
  const Sensor sensor = sensor_of(simulator, kPipelineWindow, 100.0);
  Config config;
  config.split.weighted = true;
  config.detect.method = method;
  config.track.enabled = config.split.hidden_phase = method != DetectMethod::kCirculation;
  config.pipeline.threads = threads;
  config.pipeline.slots = slots;
  Pipeline pipeline(std::make_shared<const Plan>(sensor, simulator.format(), config),
                    config.pipeline);
  WanderingSource wanderer(simulator);
  FrameSource& source = wandering ? static_cast<FrameSource&>(wanderer) : simulator;
  RecordedFeed feed(source, {});
  Collected collected;
  Publisher publisher;
  publisher.publish = [&](const FrameSlot& slot) {
    collected.frames.push_back(bytes_of(slot));
    for (const Vortex& vortex : slot.vortices)
      if (vortex.track >= 0) collected.tracks.insert(vortex.track);
    if (!reload || slot.frame_index % 10 != 9) return;
    reload(config);
    if (pipeline.adopt(std::make_shared<const Plan>(sensor, simulator.format(), config)))
      ++collected.reloads;
  };
  collected.report = pipeline.run(feed, publisher);
  return collected;
}

class PipelineOfMethod : public ::testing::TestWithParam<DetectMethod> {};

TEST_P(PipelineOfMethod, ATeamIsInlineBitForBit) {
  const Collected one = run(Threading::kInline, 1, GetParam());
  ASSERT_EQ(static_cast<std::int64_t>(one.frames.size()), kPipelineFrames);
  EXPECT_GT(one.report.vortices, kPipelineFrames / 2);
  for (const std::size_t slots : {2U, 8U}) {
    const Collected many = run(Threading::kTeam, slots, GetParam());
    ASSERT_EQ(many.frames.size(), one.frames.size());
    EXPECT_EQ(many.report.vortices, one.report.vortices);
    for (std::size_t i = 0; i < one.frames.size(); ++i)
      ASSERT_TRUE(many.frames[i] == one.frames[i]) << "frame " << i;
  }
}

INSTANTIATE_TEST_SUITE_P(Methods, PipelineOfMethod,
                         ::testing::Values(DetectMethod::kCirculation, DetectMethod::kWhitened,
                                           DetectMethod::kClassifier));

TEST(PipelineOfWanderers, WindowsThatFollowAreTheSameInlineAndInATeam) {
  const Collected one = run(Threading::kInline, 1, DetectMethod::kCirculation, true);
  const auto frames = [&](FollowState state) {
    return one.report.followed[static_cast<std::size_t>(state)];
  };
  EXPECT_EQ(frames(FollowState::kNoLight), WanderingSource::kDarkTo - WanderingSource::kDarkFrom);
  EXPECT_GE(frames(FollowState::kMoved), 3);
  EXPECT_EQ(frames(FollowState::kLost), 0);
  const Collected many = run(Threading::kTeam, 8, DetectMethod::kCirculation, true);
  ASSERT_EQ(many.frames.size(), one.frames.size());
  for (std::size_t i = 0; i < one.frames.size(); ++i)
    ASSERT_TRUE(many.frames[i] == one.frames[i]) << "frame " << i;
  EXPECT_EQ(many.report.followed, one.report.followed);
}

// Frames of 18 × 18 lenslets of 16 px are shared by four workers, whose number the list of CPUs
// gives; spots drift by most of a pitch, and are found anew after the dark.
TEST(PipelineOfLargeFrames, ATeamThatSharesThemIsInlineBitForBit) {
  constexpr int kSide = 2 * kTeamPieces + 2;  // so many rows are cut into pieces
  SimulatorOptions large = moving_vortices(std::min<std::int64_t>(kPipelineFrames, 120), 16);
  large.rows = large.cols = kSide;
  Simulator drawing(large);
  Sensor sensor = sensor_of(drawing, large.window_px, 100.0);
  sensor.method = CentroidMethod::kWeighted;
  const auto run_with = [&](Threading threads) {
    Config config;
    config.centroid.method = CentroidMethod::kWeighted;
    config.pipeline.threads = threads;
    config.pipeline.cpus = {0, 0, 0, 0};
    Simulator simulator(large);
    Pipeline pipeline(std::make_shared<const Plan>(sensor, simulator.format(), config),
                      config.pipeline);
    WanderingSource wanderer(simulator);
    RecordedFeed feed(wanderer, {});
    Collected collected;
    Publisher publisher;
    publisher.publish = [&](const FrameSlot& slot) { collected.frames.push_back(bytes_of(slot)); };
    collected.report = pipeline.run(feed, publisher);
    return collected;
  };
  const Collected one = run_with(Threading::kInline);
  EXPECT_GE(one.report.followed[static_cast<std::size_t>(FollowState::kMoved)], 2);
  const Collected many = run_with(Threading::kTeam);
  ASSERT_EQ(many.frames.size(), static_cast<std::size_t>(large.frames));
  EXPECT_EQ(many.report.followed, one.report.followed);
  for (std::size_t i = 0; i < one.frames.size(); ++i)
    ASSERT_TRUE(many.frames[i] == one.frames[i]) << "frame " << i;
}

/// This source counts up, and fails at a given frame.
class CountingSource final : public FrameSource {
 public:
  CountingSource(std::int64_t count, std::int64_t fails_at) : count_(count), fails_at_(fails_at) {
    format_.rows = format_.cols = 4 * kPipelineWindow;
  }
  const FrameFormat& format() const override { return format_; }
  std::int64_t frame_count() const override { return count_; }
  Delivery next(FrameBuffer& into) override {
    if (next_ == fails_at_) throw std::runtime_error("the camera is gone");
    if (next_ == count_) return Delivery::kEnd;
    std::memset(into.data(), 0, format_.bytes());
    into.header = {.sequence = 3 * next_++, .received = std::chrono::steady_clock::now()};
    into.rows_ready = format_.rows;
    return Delivery::kFrame;
  }

 private:
  FrameFormat format_;
  std::int64_t count_;
  std::int64_t fails_at_;
  std::int64_t next_ = 0;
};

// A reload keeps what it does not concern: with the same configuration nothing changes at all.
TEST(PipelineReload, TheSamePlanAgainChangesNoBit) {
  for (const Threading threads : {Threading::kInline, Threading::kTeam}) {
    for (const bool wandering : {false, true}) {
      if (kSanitized && wandering != (threads == Threading::kTeam)) continue;
      const Collected once = run(threads, 4, DetectMethod::kWhitened, wandering);
      const Collected reloaded =
          run(threads, 4, DetectMethod::kWhitened, wandering, [](Config&) {});
      EXPECT_GE(reloaded.reloads, 3);
      EXPECT_EQ(once.tracks, reloaded.tracks);
      EXPECT_TRUE(wandering || !once.tracks.empty());
      ASSERT_EQ(once.frames.size(), reloaded.frames.size());
      for (std::size_t i = 0; i < once.frames.size(); ++i)
        ASSERT_EQ(once.frames[i], reloaded.frames[i]) << "frame " << i;
    }
  }
}

TEST(PipelineReload, TracksGoOnUnlessTheirOwnSettingsChange) {
  constexpr std::int64_t kNewTracker = std::int64_t{1} << 40;
  const auto tracks = [](const Reload& reload) {
    return run(Threading::kInline, 1, DetectMethod::kWhitened, false, reload).tracks;
  };
  const std::set<std::int64_t> kept = tracks([](Config& config) {
    config.detect.false_alarms_per_frame *= 1.01;
    config.split.weighted = !config.split.weighted;
    config.centroid.min_snr *= 1.01;
  });
  ASSERT_FALSE(kept.empty());
  EXPECT_LT(*kept.rbegin(), kNewTracker);
  const std::set<std::int64_t> renewed =
      tracks([](Config& config) { config.track.longest_gap_frames += 1.0; });
  ASSERT_FALSE(renewed.empty());
  EXPECT_GE(*renewed.rbegin(), kNewTracker);
}

TEST(PipelineReload, ALaterPipelineGivesNoTrackNumberAgain) {
  constexpr std::int64_t kFewFrames = 12;
  Config config;
  config.track.enabled = true;
  config.detect.method = DetectMethod::kWhitened;
  config.pipeline.threads = Threading::kInline;
  Simulator simulator(moving_vortices(kFewFrames));
  const Sensor sensor = sensor_of(simulator, kPipelineWindow, 100.0);
  const auto plan = [&] {
    config.track.longest_gap_frames += 1.0;  // Each has a tracker of its own.
    return std::make_shared<const Plan>(sensor, simulator.format(), config);
  };
  std::set<std::int64_t> all;
  std::int64_t sets = 0;
  for (int pipelines = 0; pipelines < 2; ++pipelines) {
    Pipeline pipeline(plan(), config.pipeline, {}, sets);
    for (int reloads = 0; reloads < 3; ++reloads) {
      std::set<std::int64_t> tracks;
      Publisher publisher;
      publisher.publish = [&](const FrameSlot& slot) {
        for (const Vortex& vortex : slot.vortices)
          if (vortex.track >= 0) tracks.insert(vortex.track);
      };
      Simulator frames(moving_vortices(kFewFrames));
      RecordedFeed feed(frames, {});
      pipeline.run(feed, publisher);
      EXPECT_FALSE(tracks.empty());
      for (const std::int64_t track : tracks) EXPECT_TRUE(all.insert(track).second) << track;
      ASSERT_TRUE(pipeline.adopt(plan()));
    }
    sets = pipeline.sets_made();
  }
}

TEST(PipelineReload, AnOptionWithoutEffectWhileTrackingIsRefused) {
  Simulator simulator(moving_vortices(1));
  const Sensor sensor = sensor_of(simulator, kPipelineWindow, 100.0);
  Config config;
  config.detect.min_probability = 0.9;
  EXPECT_NO_THROW(Plan(sensor, simulator.format(), config));
  config.track.enabled = true;
  EXPECT_THROW(Plan(sensor, simulator.format(), config), UsageError);
}

// The second worker's frame is ready long before the first one's is published.
TEST(PipelineOfATeam, WaitingForItsTurnIsPartOfAFramesLatency) {
  CountingSource source(20, -1);
  Config config;
  config.pipeline.threads = Threading::kTeam;
  config.pipeline.cpus = {0, 0};
  config.pipeline.deadline_us = 2000.0;
  Pipeline pipeline(
      std::make_shared<const Plan>(tiled_sensor({4, 4, kPipelineWindow}), source.format(), config),
      config.pipeline);
  RecordedFeed feed(source, {});
  Publisher publisher;
  publisher.publish = [](const FrameSlot&) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  };
  EXPECT_GE(pipeline.run(feed, publisher).late, 10);
}

class PipelineModes : public ::testing::TestWithParam<Threading> {
 protected:
  RunReport run(FrameSource& source, const Publisher& publisher, RunOptions options = {}) {
    Config config;
    config.pipeline.threads = GetParam();
    config.pipeline.slots = 3;
    Pipeline pipeline(std::make_shared<const Plan>(tiled_sensor({4, 4, kPipelineWindow}),
                                                   source.format(), config),
                      config.pipeline);
    RecordedFeed feed(source, options);
    return pipeline.run(feed, publisher);
  }
};

TEST_P(PipelineModes, ASlowPublisherLosesNothing) {
  CountingSource source(40, -1);
  std::int64_t expected = 0;
  Publisher publisher;
  publisher.publish = [&](const FrameSlot& slot) {
    EXPECT_EQ(slot.frame_index, expected++);
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  };
  const RunReport report = run(source, publisher);
  EXPECT_EQ(report.frames, 40);
  EXPECT_EQ(expected, 40);
  EXPECT_EQ(report.dropped, 78) << "each sequence step of 3 means 2 lost frames";
  EXPECT_EQ(report.total.count(), 40U);
}

TEST_P(PipelineModes, AFailingSourceEndsTheRun) {
  CountingSource source(1000, 5);
  std::int64_t published = 0;
  Publisher publisher;
  publisher.publish = [&](const FrameSlot&) { ++published; };
  EXPECT_THROW(run(source, publisher), std::runtime_error);
  EXPECT_EQ(published, 5) << "the frames before the failure must be delivered";
}

TEST_P(PipelineModes, AFailingPublisherEndsTheRun) {
  CountingSource source(1'000'000'000, -1);
  Publisher publisher;
  publisher.publish = [&](const FrameSlot& slot) {
    if (slot.frame_index == 7) throw std::runtime_error("disk full");
  };
  EXPECT_THROW(run(source, publisher), std::runtime_error);
}

TEST_P(PipelineModes, StopsAfterTheFramesAskedFor) {
  CountingSource source(1000, -1);
  EXPECT_EQ(run(source, {}, {0.0, 12}).frames, 12);
}

TEST_P(PipelineModes, PaceIsKept) {
  CountingSource source(21, -1);
  // There are 20 intervals of 2 ms. The run is never faster; how much slower depends on the
  // machine.
  EXPECT_GE(run(source, {}, {500.0, -1}).seconds, 0.040);
}

INSTANTIATE_TEST_SUITE_P(Modes, PipelineModes,
                         ::testing::Values(Threading::kInline, Threading::kTeam),
                         [](const auto& mode) {
                           return std::string(mode.param == Threading::kInline ? "inline" : "team");
                         });

}  // namespace
}  // namespace curlew
