// Windows follow the spots wherever they go, or every slope is missing; none is wrong.
#include "centroiding/window_follower.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <numbers>
#include <string>
#include <vector>

#include "core/as_size.h"
#include "tests/centroiding/followed_scene.h"

namespace curlew {
namespace {

TEST(WindowFollower, LeavesWindowsWhereSpotsHaveNotMoved) {
  const FollowedScene scene;
  Following following(scene);
  for (const double shift : {0.0, 0.03, -0.05}) {
    EXPECT_EQ(following.see(tilt(shift, -shift)), FollowState::kSettled);
    EXPECT_EQ(following.centroids.n_valid, kCount * kCount);
    for (const float moved : following.centroids.moved_x_px) EXPECT_EQ(moved, 0.0F);
    for (const float low : following.centroids.low_y_px) EXPECT_EQ(low, 0.0F);
    EXPECT_LT(following.errors(tilt(shift, -shift)).mean_px, 0.02);
  }
}

TEST(WindowFollower, FindsSpotsAnywhereInASingleFrameOrSaysThatTheyAreLost) {
  const FollowedScene scene;
  int lost = 0;
  for (double x = -1.9; x < 2.0; x += 0.35) {
    for (const double y : {0.0, 0.27, -0.5, 1.1}) {
      Following following(scene);
      const FollowState state = following.see(tilt(x, y));
      const Following::Errors errors = following.errors(tilt(x, y));
      EXPECT_EQ(errors.wrong, 0) << "tilt " << x << ", " << y << " pitches";
      if (state == FollowState::kLost) {
        EXPECT_EQ(following.centroids.n_valid, 0);
        ++lost;
        continue;
      }
      EXPECT_GT(following.centroids.n_valid, 220) << x << ", " << y;
      EXPECT_LT(errors.mean_px, 0.02) << x << ", " << y;
    }
  }
  EXPECT_EQ(lost, 0) << "the rim of the beam decides in all of these";
}

TEST(WindowFollower, FindsGridsThatAreWiderNarrowerTurnedAndBent) {
  struct Bend {
    std::string name;
    double scale, turn, cubic;
  };
  for (const Bend& bend : {Bend{"wider", 0.07, 0.0, 0.0}, Bend{"narrower", -0.08, 0.0, 0.0},
                           Bend{"turned", 0.0, 0.05, 0.0}, Bend{"both", 0.05, -0.03, 0.0},
                           Bend{"coma", 0.03, 0.0, 0.008}}) {
    const FollowedScene scene;
    Following following(scene);
    const Displacement moved = [&](int row, int col) {
      const double u = col - 7.5, v = row - 7.5;
      return Place{kPitch * (bend.scale * u - bend.turn * v + bend.cubic * u * v),
                   kPitch * (bend.scale * v + bend.turn * u + bend.cubic * v * v)};
    };
    EXPECT_NE(following.see(moved), FollowState::kLost) << bend.name;
    const Following::Errors errors = following.errors(moved);
    EXPECT_EQ(errors.wrong, 0) << bend.name;
    EXPECT_LT(errors.mean_px, 0.02) << bend.name;
    EXPECT_GT(following.centroids.n_valid, 225) << bend.name;
  }
}

TEST(WindowFollower, FindsSpotsOfTurnedSensors) {
  for (const double degrees : {-20.0, 30.0, 45.0}) {
    const FollowedScene scene(degrees);
    Following following(scene);
    EXPECT_NE(following.see(tilt(0.6, -0.3)), FollowState::kLost) << degrees;
    EXPECT_EQ(following.errors(tilt(0.6, -0.3)).wrong, 0) << degrees;
    EXPECT_GT(following.centroids.n_valid, 245) << degrees;
  }
}

TEST(WindowFollower, FollowsADriftOfAPitchInAHundredFrames) {
  const FollowedScene scene;
  Following following(scene);
  for (int k = 0; k <= 100; ++k) {
    const Displacement moved = tilt(0.01 * k, -0.006 * k);
    EXPECT_LE(following.see(moved), FollowState::kMoved) << k;
    EXPECT_LT(following.errors(moved).mean_px, 0.02) << k;
    EXPECT_EQ(following.errors(moved).wrong, 0) << k;
    EXPECT_GE(following.centroids.n_valid, 240) << k;
  }
}

bool same(const FollowerMemory& a, const FollowerMemory& b) {
  return a.frames == b.frames && a.started == b.started && a.model.x == b.model.x &&
         a.model.y == b.model.y && a.level.noise == b.level.noise &&
         a.level.bound == b.level.bound && a.level.floor == b.level.floor &&
         std::equal(a.seen.begin(), a.seen.end(), b.seen.begin());
}

// Most spots have less than five times their noise, so that one by one they are missing.
TEST(WindowFollower, FollowsABeamThatIsTooFaintForSingleSpots) {
  const FollowedScene scene;
  const Brightness faint = [](int, int) { return 0.06; };
  Following following(scene);
  for (int frame = 0; frame < 60; ++frame) {
    const double shift = 0.01 * frame;
    const FollowState state = following.see(tilt(shift, -shift), faint);
    const Centroids& centroids = following.centroids;
    ASSERT_TRUE(state == FollowState::kSettled || state == FollowState::kMoved) << frame;
    EXPECT_LE(centroids.n_lost, 4) << frame;
    const auto n_faint =
        std::count(centroids.state.begin(), centroids.state.end(), LensletState::kFaint);
    EXPECT_GT(n_faint, 128) << frame;
    double mean_x = 0.0;
    for (const float x : centroids.low_x_px) mean_x += static_cast<double>(x);
    EXPECT_NEAR(mean_x / (kCount * kCount), shift * kPitch, 0.18 * kPitch) << frame;
  }
}

// Which lenslets were lit is known from bright frames, however many faint ones came between.
TEST(WindowFollower, AFaintBeamIsFoundAgainWhereItReturns) {
  const FollowedScene scene;
  const auto faint = [](const Brightness& of) {
    return [=](int row, int col) { return 0.06 * of(row, col); };
  };
  for (const double jump : {0.4, 0.8, 1.0, -1.0}) {
    for (const Brightness& bright : {Brightness(all_lit), Brightness(round_beam)}) {
      Following following(scene);
      for (int i = 0; i < 10; ++i) following.see(tilt(0.0, 0.0), bright);
      for (int i = 0; i < 12; ++i) following.see(tilt(0.0, 0.0), faint(bright));
      following.see(tilt(jump, 0.0), bright);
      const FollowState state = following.see(tilt(jump, 0.0), bright);
      EXPECT_EQ(following.errors(tilt(jump, 0.0)).wrong, 0) << jump;
      EXPECT_NE(state, FollowState::kLost) << jump;
      EXPECT_NE(state, FollowState::kNoLight) << jump;
    }
  }
}

// What noise leaves above the threshold lies anywhere.
TEST(WindowFollower, NoiseIsNoFaintBeam) {
  FollowedScene scene;
  const Brightness dark = [](int, int) { return 0.0; };
  CentroidOptions low;
  low.threshold_noise = 2.0;
  CentroidOptions weighted;
  weighted.method = CentroidMethod::kWeighted;
  for (const CentroidOptions& options : {CentroidOptions(), low, weighted}) {
    scene.sensor.method = options.method;
    for (std::uint64_t first = 0; first < 40; ++first) {
      Following following(scene, options);
      following.frames = 100 * first;
      const FollowState state = following.see(tilt(0.0, 0.0), dark);
      ASSERT_TRUE(state == FollowState::kNoLight || state == FollowState::kLost) << first;
    }
  }
}

// Two followers, of which one comes later, know the same after a few settlings; and one that
// recalls what another knew goes on as that does.
TEST(WindowFollower, ForgetsHowTheWindowsCameWhereTheyAre) {
  const FollowedScene scene;
  Following early(scene);
  Following late(scene);
  Following recalling(scene);
  constexpr int kLate = 40, kRecalled = 150;
  const int frames = 6 * static_cast<int>(WindowFollower::kSettlingFrames);
  int apart = 0;
  for (int k = 0; k < frames; ++k) {
    early.see(tilt(0.002 * k, 0.1 * std::sin(0.02 * k)), round_beam);
    if (k == kLate) {
      FollowerMemory memory = late.follower.memory();
      memory.frames = k;
      late.follower.recall(late.plan, late.level_plan, memory);
    }
    if (k >= kLate) {
      late.counts = early.counts;
      late.measure();
      apart += same(early.follower.memory(), late.follower.memory()) ? 0 : 1;
    }
    if (k >= kRecalled) {
      recalling.counts = early.counts;
      recalling.measure();
      EXPECT_TRUE(same(early.follower.memory(), recalling.follower.memory())) << k;
    }
    if (k == kRecalled - 1) {
      recalling.follower.recall(recalling.plan, recalling.level_plan, early.follower.memory());
    }
  }
  EXPECT_GT(apart, 0) << "they must begin apart, or this test shows nothing";
  EXPECT_TRUE(same(early.follower.memory(), late.follower.memory()));
}

TEST(WindowFollower, AStepIsFoundByWhichLensletsWereLit) {
  for (const Place step : {Place{0.8, 0.0}, Place{1.0, 0.0}, Place{-1.0, 1.0}, Place{0.0, -1.6}}) {
    for (const bool at_rim : {false, true}) {
      const FollowedScene scene;
      Following following(scene);
      const Brightness beam = at_rim ? all_lit : round_beam;
      for (int k = 0; k < 5; ++k) following.see(tilt(0.0, 0.0), beam);
      const Displacement moved = tilt(step[0], step[1]);
      for (int k = 0; k < 3; ++k) {
        following.see(moved, beam);
        EXPECT_EQ(following.errors(moved).wrong, 0)
            << step[0] << ", " << step[1] << " frame " << k << (at_rim ? " at the rim" : "");
      }
      EXPECT_GT(following.centroids.n_valid, at_rim ? 210 : 75) << step[0] << ", " << step[1];
    }
  }
}

TEST(WindowFollower, HalfAPitchOfABeamWithoutARimIsNotDecided) {
  // The beam is wider than the array: its spots lie beyond the array as well.
  const FollowedScene scene;
  Following following(scene);
  const auto see = [&](double pitches) {
    Image<double> light(scene.format.rows, scene.format.cols);
    for (int r = -2; r < kCount + 2; ++r)
      for (int c = -2; c < kCount + 2; ++c) {
        const auto [x, y] = scene.sensor.grid.pixel_from_lenslet(c + pitches, r);
        scene.add_spot(light, x, y, kElectrons);
      }
    RandomStream random(kSceneSeed, ++following.frames);
    following.counts = Image<std::uint16_t>(light.rows(), light.cols());
    for (std::size_t i = 0; i < light.size(); ++i)
      following.counts[i] =
          static_cast<std::uint16_t>(std::round(kBias + light[i] + kReadNoise * random.gaussian()));
    return following.measure();
  };
  EXPECT_EQ(see(0.0), FollowState::kSettled);
  EXPECT_EQ(see(0.5), FollowState::kLost);
  EXPECT_EQ(following.centroids.n_valid, 0);
  EXPECT_EQ(see(0.05), FollowState::kSettled);
}

TEST(WindowFollower, SaysThatThereIsNoLightAndGoesOnWhereItWas) {
  const FollowedScene scene;
  Following following(scene);
  following.see(tilt(0.0, 0.0), round_beam);
  for (int k = 0; k < 3; ++k) {
    EXPECT_EQ(following.see(tilt(0.0, 0.0), [](int, int) { return 0.0; }), FollowState::kNoLight);
    EXPECT_EQ(following.centroids.n_valid, 0);
  }
  const Displacement moved = tilt(0.7, 0.2);
  EXPECT_EQ(following.see(moved, round_beam), FollowState::kAcquired);
  EXPECT_EQ(following.errors(moved).wrong, 0);
  EXPECT_GT(following.centroids.n_valid, 75);
}

TEST(WindowFollower, LightWithoutALatticeIsNoSpot) {
  const FollowedScene scene;
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    Following following(scene);
    RandomStream random(kSceneSeed + seed, 7);
    std::vector<Place> places;
    for (int k = 0; k < kCount * kCount; ++k)
      places.push_back({kPitch * (random.uniform() - 0.5), kPitch * (random.uniform() - 0.5)});
    const Displacement anywhere = [&](int r, int c) { return places[as_size(r * kCount + c)]; };
    EXPECT_EQ(following.see(anywhere), FollowState::kLost) << "seed " << kSceneSeed + seed;
    EXPECT_EQ(following.centroids.n_valid, 0) << "seed " << kSceneSeed + seed;
  }
}

TEST(WindowFollower, StrayLightBesideTheBeamIsNoSpot) {
  const FollowedScene scene;
  for (std::uint64_t seed = 0; seed < 5; ++seed) {
    Following following(scene);
    RandomStream random(kSceneSeed + seed, 8);
    std::vector<Place> places;
    std::vector<double> light;
    for (int k = 0; k < kCount * kCount; ++k) {
      places.push_back({kPitch * (random.uniform() - 0.5), kPitch * (random.uniform() - 0.5)});
      light.push_back(0.3 * random.uniform());
    }
    const auto in_beam = [](int row, int col) { return round_beam(row, col) > 0.0; };
    following.see(
        [&](int r, int c) { return in_beam(r, c) ? Place{} : places[as_size(r * kCount + c)]; },
        [&](int r, int c) { return in_beam(r, c) ? 1.0 : light[as_size(r * kCount + c)]; });
    int beam = 0;
    int stray = 0;
    int evidence = 0;
    for (int r = 0; r < kCount; ++r) {
      for (int c = 0; c < kCount; ++c) {
        const bool valid = following.centroids.state(r, c) == LensletState::kValid;
        (in_beam(r, c) ? beam : stray) += valid ? 1 : 0;
        evidence += !in_beam(r, c) && following.centroids.state(r, c) != LensletState::kLost;
      }
    }
    EXPECT_GE(beam, 84) << "of 88, seed " << kSceneSeed + seed;
    EXPECT_LE(stray, 2) << "of 168, seed " << kSceneSeed + seed;
    EXPECT_LE(evidence, 20) << "seed " << kSceneSeed + seed;
  }
}

// At 5.3 px a pitch, the corners in which the level is measured see the spots round them. What they
// see must not change when these move, for it would change the spots' light above the level.
TEST(WindowFollower, TheLevelStaysWhereWideSpotsMoveByLessThanAPixel) {
  constexpr double kClose_px = 5.3;
  FollowedScene scene(0.0, kClose_px, 1.2);
  scene.sensor.spot_sigma_px = 1.0;
  const auto mean_level = [&](double dx, double dy) {
    Following following(scene);
    EXPECT_TRUE(following.level_plan.corners_are_lit());
    for (int i = 0; i < 2; ++i) following.see([=](int, int) { return Place{dx, dy}; });
    double sum = 0.0;
    for (const float level : following.levels.level) sum += static_cast<double>(level);
    return sum / static_cast<double>(following.levels.level.size());
  };
  const double still = mean_level(0.0, 0.0);
  EXPECT_GT(still, 3.0) << "the corners must be lit";
  for (const auto& [dx, dy] : {Place{0.37, -0.61}, Place{0.5, 0.5}, Place{-0.7, 0.2}})
    EXPECT_NEAR(mean_level(dx, dy), still, 0.2 * still) << dx << ", " << dy;
}

// Six hot pixels side by side outshine a spot, and no pixel of them is sharp.
TEST(WindowFollower, AClumpOfHotPixelsIsNoSpot) {
  FollowedScene scene;
  scene.sensor.spot_sigma_px = kSigma;
  Following following(scene);
  following.see(tilt(0.0, 0.0));
  ASSERT_EQ(following.centroids.n_valid, kCount * kCount);
  constexpr int kRow = 7, kCol = 8;
  const int x0 = static_cast<int>(scene.sensor.ref_x_px(kRow, kCol)) + 2;
  const int y0 = static_cast<int>(scene.sensor.ref_y_px(kRow, kCol)) - 1;
  for (int i = 0; i < 3; ++i) {
    following.counts = scene.draw(tilt(0.0, 0.0), all_lit, ++following.frames);
    for (int y = y0; y < y0 + 3; ++y)
      for (int x = x0; x < x0 + 2; ++x) following.counts(y, x) = 5000;
    following.measure();
    EXPECT_NE(following.centroids.state(kRow, kCol), LensletState::kValid) << "frame " << i;
    EXPECT_EQ(following.centroids.n_valid, kCount * kCount - 1);
  }
}

TEST(WindowFollower, TheLevelIsFoundWhereSpotsLieOnItsCorners) {
  const FollowedScene scene;
  Following following(scene);
  const Displacement moved = tilt(0.5, 0.48);
  EXPECT_NE(following.see(moved, all_lit, 40.0), FollowState::kLost);
  EXPECT_LT(following.errors(moved).mean_px, 0.02);
  for (const float level : following.levels.level) EXPECT_NEAR(level, 40.0F, 6.0F);
}

}  // namespace
}  // namespace curlew
