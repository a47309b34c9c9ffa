#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "acquisition/simulator/simulator.h"
#include "core/error.h"
#include "tests/support/frame_bytes.h"

namespace curlew {
namespace {

SimulatorOptions turbulent_options() {
  SimulatorOptions options;
  options.rows = 6;
  options.cols = 8;
  options.window_px = 6;
  options.seed = 12;
  options.frames = 4;
  options.turbulence = TurbulentPath{};
  options.turbulence->rytov_variance = 4.0;
  options.turbulence->grid = 256;
  return options;
}

TEST(SimulatedTurbulence, EveryFrameIsItsOwnWhicheverCameBefore) {
  for (const double photons : {1000.0, 0.0}) {
    SimulatorOptions options = turbulent_options();
    options.photons = photons;
    Simulator in_order(options);
    Simulator at_once(options);
    FrameBuffer a(in_order.format());
    FrameBuffer b(at_once.format());
    in_order.next(a);
    const auto first = bytes_of(a, in_order.format());
    in_order.next(a);
    in_order.next(a);
    at_once.render(2, b);
    EXPECT_EQ(bytes_of(a, in_order.format()), bytes_of(b, at_once.format()));
    EXPECT_NE(bytes_of(a, in_order.format()), first);
  }
}

TEST(SimulatedTurbulence, TruthIsThatOfTheFieldOnTheArray) {
  const SimulatorOptions options = turbulent_options();
  Simulator simulator(options);
  Propagation propagation(*options.turbulence, options.rows, options.cols,
                          min_field_samples(options), options.seed);
  std::size_t vortices = 0;
  double charges[2] = {0.0, 0.0};
  for (const std::int64_t frame : {3, 1, 1, 0, 2}) {
    SampledField field;
    propagation.propagate(frame, field);
    Scene none;
    const Beam beam(none, options.rows, options.cols, propagation.field_samples(), 1.0, field);
    std::vector<SceneVortex> expected;
    for (const SceneVortex& vortex : beam.vortices(frame)) {
      if (std::abs(vortex.x - 3.5) <= 4.0 && std::abs(vortex.y - 2.5) <= 3.0)
        expected.push_back(vortex);
    }
    const std::vector<TruthVortex> truth = simulator.truth(frame);
    ASSERT_EQ(truth.size(), expected.size());
    for (std::size_t k = 0; k < truth.size(); ++k) {
      EXPECT_EQ(truth[k].x, expected[k].x);
      EXPECT_EQ(truth[k].charge, expected[k].charge);
      EXPECT_EQ(truth[k].frame, frame);
      double nearest = INFINITY;
      for (const SceneVortex& other : beam.vortices(frame)) {
        if (other.charge == truth[k].charge) continue;
        nearest = std::min(nearest, std::hypot(other.x - truth[k].x, other.y - truth[k].y));
      }
      EXPECT_EQ(truth[k].separation, nearest);
      charges[truth[k].charge > 0 ? 1 : 0] += 1.0;
    }
    vortices += truth.size();
  }
  EXPECT_GT(vortices, 5U) << "seed " << options.seed;
  EXPECT_GT(charges[0] * charges[1], 0.0);
}

// On average a lenslet must get its photons, less what falls off the detector.
TEST(SimulatedTurbulence, LensletsGatherTheirPhotons) {
  SimulatorOptions options = turbulent_options();
  options.turbulence->rytov_variance = 0.2;
  options.turbulence->grid = 128;
  options.rows = 16;  // This is the whole grid, whose mean is 1 exactly.
  options.cols = 16;
  options.photons = 1000.0;
  options.stray_light = StrayLight::kNeighbours;
  Simulator simulator(options);
  double sum = 0.0;
  for (const float electrons : simulator.expected_image_e(1)) sum += static_cast<double>(electrons);
  // Some 2 % of the light fall off the detector's edge.
  EXPECT_NEAR(sum / 256.0, 985.0, 14.0) << "seed " << options.seed;
}

TEST(SimulatedTurbulence, NoiseFreeFramesFillTheRange) {
  SimulatorOptions options = turbulent_options();
  options.photons = 0.0;
  options.bit_depth = 16;
  Simulator simulator(options);
  FrameBuffer buffer(simulator.format());
  for (int k = 0; k < 3; ++k) {
    simulator.next(buffer);
    const auto* pixels = buffer.view().data<std::uint16_t>();
    const int peak = *std::max_element(pixels, pixels + simulator.format().pixels());
    EXPECT_NEAR(peak, 100.0 + 0.75 * (65535.0 - 100.0), 1.0);  // This is rounding.
    EXPECT_EQ(buffer.header.status, static_cast<std::uint32_t>(kFrameOk));
  }
}

TEST(SimulatedTurbulence, ChenIsThePapersBeamAndFieldFilesAreRefused) {
  SimulatorOptions options;
  add_preset("chen2007", {}, options);
  ASSERT_TRUE(options.turbulence.has_value());
  EXPECT_GT(options.turbulence->waist, 0.0);
  EXPECT_NO_THROW(check_simulator_options(options));
  EXPECT_EQ(propagation_grid(options).points, 1024);
  options.scene.field_file = "field.fits";
  EXPECT_THROW(check_simulator_options(options), UsageError);
}

}  // namespace
}  // namespace curlew
