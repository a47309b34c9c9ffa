// What is no light through the optics, or not the lenslet's own, pulls no slope that is called
// valid; and what vortices do to spots is neither.
#include "centroiding/foreign_light.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "acquisition/simulator/simulator.h"
#include "core/as_size.h"
#include "tests/centroiding/followed_scene.h"
#include "tests/support/exact_sensor.h"

namespace curlew {
namespace {

using Counts = Image<std::uint16_t>;
using Harm = std::function<void(Counts&)>;

/// The sensor's spots are at ...5 px, between four pixels.
FollowedScene scene_of_known_spots() {
  FollowedScene scene;
  scene.sensor.spot_sigma_px = kSigma;
  return scene;
}

std::uint16_t raised(std::uint16_t count, double by) {
  return static_cast<std::uint16_t>(std::clamp(std::round(count + by), 0.0, 65535.0));
}

Harm column(int x, const std::function<std::uint16_t(std::uint16_t)>& becomes) {
  return [=](Counts& counts) {
    for (int y = 0; y < counts.rows(); ++y) counts(y, x) = becomes(counts(y, x));
  };
}
Harm row(int y, const std::function<std::uint16_t(std::uint16_t)>& becomes) {
  return [=](Counts& counts) {
    for (int x = 0; x < counts.cols(); ++x) counts(y, x) = becomes(counts(y, x));
  };
}
Harm light(const std::function<double(double x, double y)>& electrons) {
  return [=](Counts& counts) {
    for (int y = 0; y < counts.rows(); ++y)
      for (int x = 0; x < counts.cols(); ++x) counts(y, x) = raised(counts(y, x), electrons(x, y));
  };
}

struct Outcome {
  int valid = 0;
  int wrong = 0;  ///< spots that are more than .25 px off and valid
};

/// Photon and read noise move a spot by .035 px along an axis.
Outcome outcome_of(const FollowedScene& scene, const Harm& harm) {
  constexpr double kWrong_px = 0.25;
  Following following(scene);
  following.counts = scene.draw(tilt(0.0, 0.0), all_lit, 1);
  harm(following.counts);
  EXPECT_EQ(following.measure(), FollowState::kSettled);
  const Centroids& centroids = following.centroids;
  Outcome outcome{.valid = centroids.n_valid};
  int valid = 0;
  for (std::size_t k = 0; k < centroids.state.size(); ++k) {
    if (centroids.state[k] != LensletState::kValid) continue;
    ++valid;
    const auto x = static_cast<double>(centroids.x_px[k] - scene.sensor.ref_x_px[k]);
    const auto y = static_cast<double>(centroids.y_px[k] - scene.sensor.ref_y_px[k]);
    outcome.wrong += std::hypot(x, y) > kWrong_px ? 1 : 0;
  }
  EXPECT_EQ(valid, centroids.n_valid);
  return outcome;
}

constexpr int kAll = kCount * kCount;
constexpr int kSpot = 131;  // A spot is at 131.5 px along either axis.

TEST(ForeignLight, ASensorWithoutAnyKeepsAllOfItsLenslets) {
  const FollowedScene scene = scene_of_known_spots();
  const Outcome outcome = outcome_of(scene, [](Counts&) {});
  EXPECT_EQ(outcome.valid, kAll);
  EXPECT_EQ(outcome.wrong, 0);
}

TEST(ForeignLight, LinesThatDiedOrShineTakeOutTheLensletsThatTheyCross) {
  const FollowedScene scene = scene_of_known_spots();
  const auto dead = [](std::uint16_t) { return std::uint16_t{0}; };
  const auto dim = [](std::uint16_t) { return std::uint16_t{60}; };
  const auto bright = [](std::uint16_t count) { return raised(count, 50.0); };
  const auto stuck = [](std::uint16_t) { return std::uint16_t{4000}; };
  const std::vector<std::pair<std::string, Harm>> harms = {
      {"dead column", column(kSpot + 2, dead)}, {"dead row", row(kSpot - 1, dead)},
      {"dim column", column(kSpot - 1, dim)},   {"bright column", column(kSpot + 4, bright)},
      {"bright row", row(kSpot - 3, bright)},   {"stuck column", column(kSpot + 3, stuck)},
      {"stuck row", row(kSpot + 2, stuck)}};
  for (const auto& [name, harm] : harms) {
    const Outcome outcome = outcome_of(scene, harm);
    EXPECT_EQ(outcome.wrong, 0) << name;
    EXPECT_GE(outcome.valid, kAll - kCount) << name;
    EXPECT_LT(outcome.valid, kAll) << name;
  }
}

// Half of a column is dead where the transfer of charge is stuck; few lenslets lose little of it.
TEST(ForeignLight, ManyDeadColumnsLeaveNoWrongSlope) {
  const FollowedScene scene = scene_of_known_spots();
  const Outcome outcome = outcome_of(scene, [](Counts& counts) {
    for (int x = 40; x < 200; x += 7)
      for (int y = 0; y < counts.rows() / 2; ++y) counts(y, x) = 0;
  });
  EXPECT_EQ(outcome.wrong, 0);
  EXPECT_GE(outcome.valid, kAll / 2);
}

TEST(ForeignLight, NeighboursStandInForASingleDeadPixel) {
  const FollowedScene scene = scene_of_known_spots();
  const Outcome outcome = outcome_of(scene, [](Counts& counts) {
    for (int i = 2; i < 14; ++i) counts(35 + 12 * i, 34 + 12 * i) = 0;
  });
  EXPECT_GE(outcome.valid, kAll - 2) << "a spot may come out unlike the others";
  EXPECT_EQ(outcome.wrong, 0);
}

TEST(ForeignLight, ClumpsOfHotPixelsTakeOutTheirLenslets) {
  const FollowedScene scene = scene_of_known_spots();
  for (const auto& [rows, cols] : {std::pair{2, 2}, std::pair{3, 2}, std::pair{3, 3}}) {
    for (const double electrons : {100.0, 400.0, 5000.0}) {
      const Outcome outcome = outcome_of(scene, [rows = rows, cols = cols, electrons](Counts& c) {
        for (int i = 2; i < 12; ++i)
          for (int y = 0; y < rows; ++y)
            for (int x = 0; x < cols; ++x) {
              std::uint16_t& count = c(35 + 12 * i + 3 + y, 35 + 12 * (14 - i) - 4 + x);
              count = raised(count, electrons);
            }
      });
      EXPECT_EQ(outcome.wrong, 0) << rows << " x " << cols << ", " << electrons << " e";
      EXPECT_GE(outcome.valid, kAll - 20) << rows << " x " << cols << ", " << electrons << " e";
      EXPECT_LE(outcome.valid, kAll - 10) << rows << " x " << cols << ", " << electrons << " e";
    }
  }
}

TEST(ForeignLight, GhostsTakeOutTheLensletsThatTheyPull) {
  const FollowedScene scene = scene_of_known_spots();
  const auto blob = [](double x, double y) {
    return 70.0 * std::exp(-((x - 104.0) * (x - 104.0) + (y - 134.0) * (y - 134.0)) / 72.0);
  };
  const auto spots = [](double x, double y) {  // of half the light, beside nine spots
    double electrons = 0.0;
    for (int i = 0; i < 9; ++i) {
      const double dx = x - (135.5 + 12.0 * (i % 3)), dy = y - (134.5 + 12.0 * (i / 3));
      electrons += 106.0 * std::exp(-(dx * dx + dy * dy) / (2.0 * kSigma * kSigma));
    }
    return electrons;
  };
  const auto step = [](double x, double) { return x > 130.0 ? 30.0 : 0.0; };
  const std::vector<std::pair<std::string, Harm>> harms = {
      {"blob", light(blob)}, {"second images", light(spots)}, {"step of the level", light(step)}};
  for (const auto& [name, harm] : harms) {
    const Outcome outcome = outcome_of(scene, harm);
    EXPECT_EQ(outcome.wrong, 0) << name;
    EXPECT_GE(outcome.valid, kAll - 2 * kCount) << name;
    EXPECT_LT(outcome.valid, kAll) << name;
  }
}

// Light that lies evenly, or rises evenly over the frame, pulls little.
TEST(ForeignLight, AnEvenSkyIsNone) {
  const FollowedScene scene = scene_of_known_spots();
  EXPECT_EQ(outcome_of(scene, light([](double, double) { return 40.0; })).valid, kAll);
  EXPECT_EQ(outcome_of(scene, light([](double x, double) { return 0.2 * x; })).valid, kAll);
}

// Rows that are measured while they arrive give the same bits.
TEST(ForeignLight, IsTheSameInAFrameThatArrivesRowByRow) {
  const FollowedScene scene = scene_of_known_spots();
  CentroidOptions options;
  options.measure_ahead = true;
  Following whole(scene, options), arriving(scene, options);
  int ahead = 0;
  for (std::uint64_t number = 1; number <= 4; ++number) {
    whole.counts = scene.draw(tilt(0.03, -0.02), all_lit, number);
    column(kSpot + 2, [](std::uint16_t) { return std::uint16_t{0}; })(whole.counts);
    column(kSpot + 40, [](std::uint16_t count) { return raised(count, 60.0); })(whole.counts);
    for (int y = 62; y < 65; ++y)
      for (int x = 80; x < 82; ++x) whole.counts(y, x) = 900;
    arriving.counts = whole.counts;
    for (int ready = 5; ready < whole.counts.rows(); ready += 11)
      ahead = std::max(ahead, arriving.measure_ahead(ready));
    whole.measure();
    arriving.measure();
    for (std::size_t k = 0; k < whole.centroids.state.size(); ++k) {
      ASSERT_EQ(whole.centroids.state[k], arriving.centroids.state[k]) << number << ", " << k;
      ASSERT_EQ(whole.centroids.x_px[k], arriving.centroids.x_px[k]) << number << ", " << k;
      ASSERT_EQ(whole.centroids.y_px[k], arriving.centroids.y_px[k]) << number << ", " << k;
    }
  }
  EXPECT_GT(ahead, kCount / 2) << "hardly anything was measured ahead, so this shows nothing";
}

/// Returns how many lenslets of a simulated beam with eight vortices are missing for what this file
/// is about.
int lost_in(double photons, double samples_per_lambda_w, int window_px) {
  SimulatorOptions options;
  options.rows = options.cols = kCount;
  options.window_px = window_px;
  options.samples_per_lambda_w = samples_per_lambda_w;
  options.stray_light = StrayLight::kNeighbours;
  options.photons = photons;
  options.read_noise_e = 2.0;
  options.bit_depth = 16;
  options.frames = 2;
  options.scene.vortices = {{2.3, 2.6, 1},  {6.1, 3.0, -1}, {10.5, 2.5, 1},  {13.8, 6.7, -1},
                            {3.0, 8.2, -1}, {8.0, 8.4, 1},  {12.2, 12.6, 1}, {5.4, 12.1, -1}};
  options.scene.vortex_amplitude = VortexAmplitude::kLinearCore;
  options.scene.core_radius = 1.5;
  Simulator simulator(options);
  Sensor sensor = sensor_of(simulator, window_px, options.bias_adu);
  sensor.spot_sigma_px = sensor.spot_gaussian_px = 0.42 * samples_per_lambda_w;
  sensor.flux_adu.fill(static_cast<float>(photons));
  const CentroidPlan plan(sensor, simulator.format());
  const LevelPlan level_plan(sensor, plan, {});
  const SharpPixelPlan sharp_plan(sensor, simulator.format());
  ForeignLight foreign_light(sensor, plan);
  std::vector<std::uint8_t> row_changed(kCount);
  FrameLevels levels(level_plan);
  SharpPixels sharp(kCount, kCount);
  Centroids centroids(kCount, kCount);
  FrameBuffer frame(simulator.format());
  int lost = 0;
  for (std::int64_t number = 0; number < options.frames; ++number) {
    simulator.render(number, frame);
    measure_levels(level_plan, level_plan.pixels(), frame.view(), levels);
    find_sharp_pixels(sharp_plan, plan, plan.spots, frame.view(), levels, sharp);
    find_centroids(plan, frame.view(), centroids, {&levels, &sharp});
    foreign_light.mark(levels, centroids, row_changed);
    EXPECT_GT(centroids.n_valid, kAll / 2);
    lost += static_cast<int>(
        std::count_if(centroids.state.begin(), centroids.state.end(), [](LensletState state) {
          return state == LensletState::kLost || state == LensletState::kBadPixels;
        }));
  }
  return lost;
}

TEST(ForeignLight, VorticesMakeNone) {
  for (const double photons : {1000.0, 50000.0}) {
    EXPECT_EQ(lost_in(photons, 3.6, 12), 0) << photons;
    EXPECT_EQ(lost_in(photons, 2.6, 10), 0) << photons;
    EXPECT_EQ(lost_in(photons, 2.0, 8), 0) << photons;
  }
}

}  // namespace
}  // namespace curlew
