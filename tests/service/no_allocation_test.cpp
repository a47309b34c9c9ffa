// The frame path allocates nothing: every malloc of the process is counted while frames run.
#include <gtest/gtest.h>

#include <new>
#include <tuple>

#include "acquisition/paced_camera.h"
#include "acquisition/simulator/simulator.h"
#include "service/daemon/live_statistics.h"
#include "service/live_feed.h"
#include "service/pipeline.h"
#include "tests/support/allocation_counter.h"
#include "tests/support/exact_sensor.h"

namespace curlew {
namespace {

constexpr int kNoAllocationWindow = 8;

/// Returns a scene of a pupil with a hole, vortices, and lenslets that fade in some frames.
SimulatorOptions busy_scene() {
  SimulatorOptions options;
  options.rows = options.cols = 12;
  options.window_px = kNoAllocationWindow;
  options.pupil = PupilShape::kObscured;
  options.photons = 150.0;
  options.scene.core_radius = 1.5;
  options.frames = -1;
  options.scene.vortices = {{3.2, 4.6, 1}, {8.1, 6.7, -1}};
  options.scene.vortex_amplitude = VortexAmplitude::kLinearCore;
  return options;
}

TEST(NoAllocation, TheCounterCounts) {
  if (!kCountsAllocations) GTEST_SKIP() << "the sanitizer owns malloc";
  allocations = 0;
  counting = true;
  void* volatile seen = ::operator new(3);  // volatile, or the compiler would take the pair out
  ::operator delete(seen);
  seen = ::operator new (64, std::align_val_t{64});
  ::operator delete (seen, std::align_val_t{64});
  counting = false;
  EXPECT_EQ(allocations, 2);
}

TEST(NoAllocation, NoCentroidMethodAllocates) {
  if (!kCountsAllocations) GTEST_SKIP() << "the sanitizer owns malloc";
  Simulator simulator(busy_scene());
  Sensor sensor = sensor_of(simulator, kNoAllocationWindow, 100.0);
  FrameBuffer frame(simulator.format());
  Centroids centroids(sensor.valid.rows(), sensor.valid.cols());
  for (std::size_t i = 0; i < kCentroidMethodNames.size(); ++i) {
    SCOPED_TRACE(kCentroidMethodNames[i]);
    CentroidOptions options;
    options.method = sensor.method = static_cast<CentroidMethod>(i);
    const CentroidPlan plan(sensor, simulator.format(), options);
    ASSERT_EQ(simulator.next(frame), Delivery::kFrame);
    find_centroids(plan, frame.view(), centroids);  // the first call chooses the instruction set
    allocations = 0;
    counting = true;
    find_centroids(plan, frame.view(), centroids);
    counting = false;
    EXPECT_EQ(allocations, 0);
    EXPECT_GT(centroids.n_valid, 0);
  }
}

class NoAllocationModes
    : public ::testing::TestWithParam<std::tuple<Threading, bool, DetectMethod>> {
 protected:
  /// Tracks and the hidden phase are on with the methods that suit them.
  static Config config() {
    const auto [threads, weighted, method] = GetParam();
    Config config;
    config.centroid.measure_ahead = true;
    config.split.weighted = weighted;
    config.pipeline.threads = threads;
    config.detect.method = method;
    config.track.enabled = config.split.hidden_phase = method != DetectMethod::kCirculation;
    return config;
  }
};

TEST_P(NoAllocationModes, AThousandFrames) {
  if (!kCountsAllocations) GTEST_SKIP() << "the sanitizer owns malloc";
  Simulator simulator(busy_scene());
  const Sensor sensor = sensor_of(simulator, kNoAllocationWindow, 100.0);
  const Config config = NoAllocationModes::config();
  const auto plan = std::make_shared<const Plan>(sensor, simulator.format(), config);
  Pipeline pipeline(plan, config.pipeline);
  RecordedFeed feed(simulator, {0.0, 1100});
  int faded = 0;
  Publisher publisher;
  publisher.publish = [&](const FrameSlot& slot) {
    // Threads and queues settle during the first frames. Then a thousand frames are counted.
    if (slot.frame_index == 50) counting = true;
    if (slot.frame_index == 1050) counting = false;
    if (slot.slopes.n_valid < plan->split.lattice().n_lenslets()) ++faded;
  };
  allocations = 0;
  const RunReport report = pipeline.run(feed, publisher);
  counting = false;
  EXPECT_EQ(allocations, 0);
  EXPECT_GT(faded, 100) << "frames with faded lenslets must be among those counted";
  EXPECT_GT(report.vortices, 0);
}

class NoAllocationLive : public NoAllocationModes {
 protected:
  /// Counts over a thousand frames of a camera that takes so long to read one out.
  static void run_camera(double readout_us) {
    auto simulator = std::make_unique<Simulator>(busy_scene());
    const FrameFormat format = simulator->format();
    const Config config = NoAllocationModes::config();
    const auto plan = std::make_shared<const Plan>(
        sensor_of(*simulator, kNoAllocationWindow, 100.0), format, config);
    Pipeline pipeline(plan, config.pipeline);
    const auto camera =
        make_paced_camera(std::move(simulator), {.rate_hz = 5000.0, .readout_us = readout_us},
                          {"simulator", {}, {}}, {});
    FrameExchange exchange(format, config.pipeline.slots + 4);
    FeedControl control;
    LiveFeed feed(exchange, {.end_index = 1100}, control);
    LiveStatistics statistics;
    Publisher publisher;
    publisher.finish = [&](const FrameSlot& slot, std::int64_t) {
      if (slot.frame_index == 50) counting = true;
      if (slot.frame_index == 1050) counting = false;
      statistics.add(slot);
    };
    allocations = 0;
    {
      const Streaming streaming(*camera, exchange);
      EXPECT_EQ(pipeline.run(feed, publisher).frames, 1100);
    }
    counting = false;
    EXPECT_EQ(allocations, 0);
  }
};

TEST_P(NoAllocationLive, AThousandWholeFrames) {
  if (!kCountsAllocations) GTEST_SKIP() << "the sanitizer owns malloc";
  run_camera(0.0);
}

TEST_P(NoAllocationLive, AThousandFramesReadOutRowByRow) {
  if (!kCountsAllocations) GTEST_SKIP() << "the sanitizer owns malloc";
  run_camera(100.0);
}

const auto kAllModes =
    ::testing::Combine(::testing::Values(Threading::kInline, Threading::kTeam), ::testing::Bool(),
                       ::testing::Values(DetectMethod::kCirculation, DetectMethod::kWhitened,
                                         DetectMethod::kClassifier));
INSTANTIATE_TEST_SUITE_P(Modes, NoAllocationModes, kAllModes);
INSTANTIATE_TEST_SUITE_P(Modes, NoAllocationLive, kAllModes);

}  // namespace
}  // namespace curlew
