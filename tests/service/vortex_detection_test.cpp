// Vortices behind turbulence, through the pipeline as it is shipped.
#include "service/vortex_detection.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <set>
#include <utility>
#include <vector>

#include "acquisition/loop_source.h"
#include "acquisition/simulator/simulator.h"
#include "core/error.h"
#include "detect/circulation.h"
#include "service/bench/bench_frames.h"
#include "service/bench/detection_dataset.h"
#include "service/bench/detection_score.h"
#include "service/pipeline.h"
#include "tests/support/exact_sensor.h"
#include "tests/support/sanitized.h"

namespace curlew {
namespace {

constexpr std::uint64_t kDetectionSeed = 7801;
constexpr int kFramesToCompare = kSanitized ? 6 : 12;
constexpr int kMayDiffer = kSanitized ? 2 : 1;  // vortices

/// Returns the benchmark's turbulence with the simulator's own noise.
SimulatorOptions turbulence(double photons, int frames) {
  SimulatorOptions options = simulator_options({.rytov_variance = 2.0}, kDetectionSeed);
  options.photons = photons;
  options.read_noise_e = 1.0;
  options.bit_depth = 12;
  options.frames = frames;
  return options;
}

/// Frames and their truth, drawn once however many pipelines see them.
struct DrawnFrames {
  explicit DrawnFrames(const SimulatorOptions& options)
      : simulator(options), sensor(sensor_of(simulator, options.window_px, 100.0)) {
    for (int i = 0; i < options.frames; ++i) {
      auto frame = std::make_shared<FrameBuffer>(simulator.format());
      simulator.next(*frame);
      frames.push_back(std::move(frame));
      truth.push_back(simulator.truth(i));
    }
  }

  Simulator simulator;
  Sensor sensor;
  LoopSource::Frames frames;
  std::vector<std::vector<TruthVortex>> truth;  ///< of each frame
};

/// Returns frames with 1000 photons a lenslet.
const DrawnFrames& usual_frames() {
  static const DrawnFrames frames(turbulence(1000.0, kFramesToCompare));
  return frames;
}

struct Counts {
  int required = 0;
  int hits = 0;
  int false_alarms = 0;
};

Counts count(DetectMethod method, const DrawnFrames& drawn, bool follow = true) {
  const Sensor& sensor = drawn.sensor;
  Config config;
  config.detect.method = method;
  config.centroid.follow_windows = follow;
  Pipeline pipeline(std::make_shared<const Plan>(sensor, drawn.simulator.format(), config),
                    config.pipeline);
  LoopSource source(drawn.frames, std::ssize(drawn.frames));
  RecordedFeed feed(source, {});
  Counts counts;
  Publisher publisher;
  publisher.publish = [&](const FrameSlot& slot) {
    std::vector<SceneVortex> scene;
    for (const TruthVortex& vortex : drawn.truth[static_cast<std::size_t>(slot.frame_index)])
      scene.push_back({.x = vortex.x, .y = vortex.y, .charge = vortex.charge});
    const FrameVerdicts frame =
        judge_frame(candidates_by_probability(slot.vortices), grade_vortices(scene),
                    {sensor.grid.rows, sensor.grid.cols});
    counts.required += frame.required;
    for (const Verdict& verdict : frame.verdicts)
      ++(verdict.hit ? counts.hits : counts.false_alarms);
  };
  pipeline.run(feed, publisher);
  return counts;
}

// Vortices sit in the dark. Without weak spots hardly any vortex is found.
TEST(VortexDetection, TheClassifierFindsVorticesInTheDark) {
  const Counts counts = count(DetectMethod::kClassifier, usual_frames());
  SCOPED_TRACE("seed " + std::to_string(kDetectionSeed));
  ASSERT_GE(counts.required, 10);
  EXPECT_GE(counts.hits, counts.required * 6 / 10) << "of " << counts.required;
  EXPECT_LE(counts.false_alarms, counts.hits / 4);
}

TEST(VortexDetection, TheWhitenedFilterFindsSomeAndHardlyAFalseOne) {
  const Counts counts = count(DetectMethod::kWhitened, usual_frames());
  SCOPED_TRACE("seed " + std::to_string(kDetectionSeed));
  EXPECT_GE(counts.hits, counts.required / 5) << "of " << counts.required;
  EXPECT_LE(counts.false_alarms, counts.hits / 3);
}

// Lenslets in the dark that a vortex makes must not be taken for lenslets without a beam.
TEST(VortexDetection, FollowingTheSpotsCostsNoVortices) {
  for (const DetectMethod method :
       {DetectMethod::kCirculation, DetectMethod::kWhitened, DetectMethod::kClassifier}) {
    const Counts still = count(method, usual_frames(), false);
    const Counts following = count(method, usual_frames(), true);
    SCOPED_TRACE("seed " + std::to_string(kDetectionSeed) + ", method " +
                 std::to_string(static_cast<int>(method)));
    EXPECT_GE(following.hits, still.hits - still.hits / 20 - kMayDiffer) << "of " << still.required;
    EXPECT_LE(following.false_alarms, still.false_alarms + 2 + still.hits / 20);
  }
}

// A sky of 10 electrons a pixel made 46 false vortices a frame when the network took the level from
// the sensor file.
TEST(VortexDetection, TheClassifierFollowsTheLevel) {
  SimulatorOptions sky = turbulence(1000.0, kFramesToCompare);
  sky.background_e = 10.0;
  const Counts known = count(DetectMethod::kClassifier, usual_frames());
  const Counts counts = count(DetectMethod::kClassifier, DrawnFrames(sky));
  EXPECT_LE(counts.false_alarms, 3 * kFramesToCompare);
  EXPECT_GE(counts.hits, known.hits / 2 - kMayDiffer) << "of " << counts.required;  // noisier, too
}

// A tilt moves the spots by 5 px, to the rim of their windows of ±6 px, and the network looks where
// they are.
TEST(VortexDetection, TheClassifierFollowsTheSpots) {
  SimulatorOptions tilted = turbulence(1000.0, 6);
  tilted.window_px = 12;
  tilted.stray_light = StrayLight::kNeighbours;
  const Counts straight = count(DetectMethod::kClassifier, DrawnFrames(tilted));
  tilted.scene.tilt_x_rad = 5.0 * 2.0 * std::numbers::pi / tilted.samples_per_lambda_w;
  const Counts counts = count(DetectMethod::kClassifier, DrawnFrames(tilted));
  EXPECT_GE(counts.hits, straight.hits * 8 / 10) << "of " << counts.required;
  EXPECT_LE(counts.false_alarms, straight.false_alarms + straight.hits / 5);
}

TEST(VortexDetection, TracksKeepTheirNumbersFromFrameToFrame) {
  SimulatorOptions options;
  options.rows = options.cols = 12;
  options.window_px = 8;
  options.photons = 1000.0;
  options.frames = 60;
  options.seed = kDetectionSeed;
  options.scene.vortices = {{3.2, 4.6, 1}, {8.1, 6.7, -1}};
  options.scene.vortex_amplitude = VortexAmplitude::kLinearCore;
  options.scene.core_radius = 1.5;
  options.scene.velocity_x = 0.03;  // pitches a frame
  Simulator simulator(options);
  Config config;
  config.detect.method = DetectMethod::kClassifier;
  config.track.enabled = true;
  Pipeline pipeline(
      std::make_shared<const Plan>(sensor_of(simulator, 8, 100.0), simulator.format(), config),
      config.pipeline);
  RecordedFeed feed(simulator, {});
  std::set<std::pair<std::int64_t, std::int32_t>> tracks;
  double velocity_x = 0.0;
  std::size_t last = 0;
  Publisher publisher;
  publisher.publish = [&](const FrameSlot& slot) {
    last = slot.vortices.size();
    for (const Vortex& vortex : slot.vortices) {
      EXPECT_GE(vortex.track, 0);
      tracks.emplace(vortex.track, vortex.charge);
      velocity_x = static_cast<double>(vortex.velocity_x);
    }
  };
  pipeline.run(feed, publisher);
  EXPECT_EQ(last, 2U);
  EXPECT_EQ(tracks.size(), 2U) << "each of the two vortices must have one track";
  constexpr double kFrame_s = 1e-3;  // the time between the simulator's frames
  EXPECT_NEAR(velocity_x * kFrame_s, 0.03, 0.02);
}

TEST(VortexDetection, WithoutVorticesTheWholePhaseIsTheLeastSquaresPhase) {
  SimulatorOptions options;
  options.rows = options.cols = 8;
  options.photons = 5000.0;
  options.frames = 5;
  options.seed = kDetectionSeed;
  options.scene.zernikes = {{4, 1.0}};
  Simulator simulator(options);
  Config config;
  config.split.hidden_phase = true;
  Pipeline pipeline(std::make_shared<const Plan>(sensor_of(simulator, options.window_px, 100.0),
                                                 simulator.format(), config),
                    config.pipeline);
  RecordedFeed feed(simulator, {});
  int compared = 0;
  Publisher publisher;
  publisher.publish = [&](const FrameSlot& slot) {
    for (std::size_t k = 0; k < slot.whole_phase.size(); ++k, ++compared)
      EXPECT_EQ(slot.whole_phase[k], slot.split.phase[k]);
  };
  pipeline.run(feed, publisher);
  EXPECT_EQ(compared, 5 * 64);
}

/// Returns what the plan's refusal says, or an empty text if the plan is made.
std::string refusal(const Sensor& sensor, const FrameFormat& format, const Config& config) {
  try {
    const VortexDetectionPlan plan(sensor, format, config);
  } catch (const UsageError& error) {
    return error.what();
  }
  return {};
}

TEST(VortexDetection, WhatTheClassifierWasNotTaughtIsRefused) {
  Simulator simulator(turbulence(1000.0, 1));
  Config config;
  config.detect.method = DetectMethod::kClassifier;
  Sensor turned = sensor_of(simulator, 6, 100.0);
  turned.grid.p21 = 0.2 * turned.grid.p11;
  EXPECT_EQ(refusal(turned, simulator.format(), config), "");
  Sensor blurred = sensor_of(simulator, 6, 100.0);
  blurred.spot_blur_px = 2.0;  // where λ/w is 2 px
  EXPECT_NE(refusal(blurred, simulator.format(), config).find("spots are blurred"),
            std::string::npos);
  config.detect.method = DetectMethod::kWhitened;
  EXPECT_EQ(refusal(blurred, simulator.format(), config), "");
}

// Slopes are finite wherever they come from. Even if one were not, what is published would be.
TEST(VortexDetection, WhatIsNotFiniteIsLeftOut) {
  for (const DetectMethod method : {DetectMethod::kCirculation, DetectMethod::kWhitened}) {
    const BenchCase size{10, 10, 8};
    Config config;
    config.detect.method = method;
    const VortexDetectionPlan plan(tiled_sensor(size), bench_format(size, PixelType::kU16), config);
    VortexDetectionWorkspace workspace(plan);
    SlopeField slopes(10, 10);
    for (std::size_t k = 0; k < slopes.valid.size(); ++k) {
      slopes.valid[k] = 1;
      slopes.variance_x[k] = slopes.variance_y[k] = 0.01F;
    }
    slopes.n_valid = 100;
    slopes.x(4, 4) = std::numeric_limits<float>::quiet_NaN();
    slopes.x(7, 2) = 3e38F;
    slopes.y(7, 2) = -3e38F;
    const Centroids centroids(10, 10);
    CirculationMap circulation(10, 10);
    VortexList candidates(plan.candidate_capacity());
    circulate(slopes, circulation);
    detect_candidates(plan, {}, nullptr, centroids, slopes, circulation, workspace, candidates);
    for (const Vortex& v : candidates)
      EXPECT_TRUE(std::isfinite(v.x + v.y + v.circulation + v.significance + v.probability));
  }
}

}  // namespace
}  // namespace curlew
