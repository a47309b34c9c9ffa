// The three exact values of a vortex on a node, through the real stages.
#include <gtest/gtest.h>

#include "acquisition/simulator/simulator.h"
#include "detect/circulation.h"
#include "service/stages.h"
#include "tests/support/analytic_slopes.h"
#include "tests/support/exact_sensor.h"

namespace curlew {
namespace {

constexpr int kSize = 12;
constexpr double kNode = 5.5;  // between lenslets 5 and 6

struct Seen {
  Vortex vortex;
  std::size_t vortices = 0;
  float solenoidal_d = 0;
};

/// Splits the slopes, and then finds vortices in what the split leaves over.
Seen split_and_find(const SlopeField& slopes) {
  const SplitPlan split_plan(slopes.valid, {});
  SplitWorkspace workspace(split_plan);
  HodgeSplit split(slopes.rows(), slopes.cols());
  split_slopes(split_plan, slopes, workspace, split);
  SlopeField solenoidal = slopes;
  solenoidal.x = split.solenoidal_x;
  solenoidal.y = split.solenoidal_y;
  CirculationMap map(slopes.rows(), slopes.cols());
  circulate(solenoidal, map);
  const CirculationPlan detect({}, slopes.valid, 16);
  VortexList list(16);
  find_circulation_vortices(detect, map, list);
  Seen seen;
  seen.vortices = list.size();
  if (!list.empty()) seen.vortex = list[0];
  seen.solenoidal_d = map.value(5, 5);
  return seen;
}

void expect_on_node(const Seen& seen, double circulation, double tolerance) {
  ASSERT_EQ(seen.vortices, 1U);
  EXPECT_EQ(seen.vortex.charge, 1);
  EXPECT_NEAR(static_cast<double>(seen.vortex.circulation), circulation, tolerance);
  EXPECT_NEAR(static_cast<double>(seen.solenoidal_d), circulation, tolerance);
  EXPECT_NEAR(static_cast<double>(seen.vortex.x), kNode, 1e-3);
  EXPECT_NEAR(static_cast<double>(seen.vortex.y), kNode, 1e-3);
}

// The tolerance of 1e-5 is for eight float slopes of 1.1 rad each, and the split's rounding.
TEST(VortexTruth, UniformAverageOfACanonicalVortex) {
  const std::vector<TestVortex> vortex{{kNode, kNode, 1, 0.0, 0.0}};
  expect_on_node(split_and_find(uniform_vortex_slopes(kSize, kSize, vortex)), 4.527887, 1e-5);
}

TEST(VortexTruth, IntensityWeightedLinearCore) {
  const std::vector<TestVortex> vortex{{kNode, kNode, 1, 0.0, 0.0}};
  expect_on_node(split_and_find(linear_core_slopes(kSize, kSize, vortex)), 3.0, 1e-5);
}

/// Sees the vortex through noise-free spots, in windows of ±4 λ/w with pixels of half a λ/w.
Seen through_spots(VortexAmplitude amplitude) {
  constexpr int kWindow = 16;
  SimulatorOptions options;
  options.rows = options.cols = kSize;
  options.window_px = kWindow;
  options.photons = 0.0;
  options.bit_depth = 16;
  options.scene.vortices = {{kNode, kNode, 1, 0.0, 0.0}};
  options.scene.vortex_amplitude = amplitude;
  Simulator simulator(options);
  const Sensor sensor = sensor_of(simulator, kWindow, options.bias_adu);
  const Plan plan(sensor, simulator.format(), {});
  FrameSlot slot(plan);
  FrameBuffer frame(simulator.format());
  EXPECT_EQ(simulator.next(frame), Delivery::kFrame);
  find_centroids(plan.centroid, frame.view(), slot.centroids);
  measure_slopes(plan.slopes, slot.centroids, slot.slopes);
  return split_and_find(slot.slopes);
}

TEST(VortexTruth, LinearCoreThroughSimulatedSpots) {
  expect_on_node(through_spots(VortexAmplitude::kLinearCore), 3.05, 0.05);
}

TEST(VortexTruth, UniformAmplitudeThroughSimulatedSpots) {
  expect_on_node(through_spots(VortexAmplitude::kUniform), 4.23, 0.05);
}

}  // namespace
}  // namespace curlew
