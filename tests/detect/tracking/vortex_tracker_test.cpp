#include "detect/tracking/vortex_tracker.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <numeric>
#include <set>
#include <string>
#include <vector>

#include "acquisition/simulator/random_stream.h"
#include "core/error.h"

namespace curlew {
namespace {

constexpr int kTrackLenslets = 16;
constexpr std::size_t kCapacity = 64;
constexpr double kTrackFrameS = 2e-3;
constexpr double kErrorRms = 0.2;  // rms error of candidates along an axis, pitches

Vortex candidate(double x, double y, int charge, double probability) {
  Vortex vortex;
  vortex.x = static_cast<float>(x);
  vortex.y = static_cast<float>(y);
  vortex.charge = charge;
  vortex.probability = static_cast<float>(probability);
  vortex.variance_x = vortex.variance_y = static_cast<float>(kErrorRms * kErrorRms);
  return vortex;
}

/// Returns options for errors that are independent from frame to frame, so that no part of them
/// lasts.
TrackerOptions independent_errors() {
  TrackerOptions options;
  options.lasting_error = 0.0;
  return options;
}

VortexTracker make_tracker(const TrackerOptions& options = independent_errors()) {
  return {options, kTrackLenslets, kTrackLenslets, kCapacity};
}

VortexList update(VortexTracker& tracker, int frame, const std::vector<Vortex>& candidates) {
  VortexList list(256);
  for (const Vortex& one : candidates) list.push(one);
  tracker.update(kTrackFrameS * frame, list);
  return list;
}

TEST(VortexTracker, KnowsTheVelocityWithinItsCovariance) {
  // Many vortices are tracked, each alone and with a velocity of its own, so that no common drift
  // is known.
  constexpr int kTrials = 60;
  constexpr int kFrames = 40;
  double velocity_error2 = 0.0, position_error2 = 0.0, stated = 0.0;
  int n = 0;
  for (int trial = 0; trial < kTrials; ++trial) {
    RandomStream random(2, static_cast<std::uint64_t>(trial));
    const double vx = 0.2 * (random.uniform() - 0.5), vy = 0.2 * (random.uniform() - 0.5);
    VortexTracker tracker = make_tracker();
    VortexList list(16);
    for (int f = 0; f < kFrames; ++f) {
      list = update(tracker, f,
                    {candidate(7.5 + vx * f + kErrorRms * random.gaussian(),
                               7.5 + vy * f + kErrorRms * random.gaussian(), 1, 0.9)});
    }
    ASSERT_EQ(list.size(), 1U) << "trial " << trial;
    ASSERT_GE(list[0].track, 0);
    const double last = kFrames - 1;
    velocity_error2 += std::pow(kTrackFrameS * static_cast<double>(list[0].velocity_x) - vx, 2) +
                       std::pow(kTrackFrameS * static_cast<double>(list[0].velocity_y) - vy, 2);
    position_error2 += std::pow(static_cast<double>(list[0].x) - 7.5 - vx * last, 2) +
                       std::pow(static_cast<double>(list[0].y) - 7.5 - vy * last, 2);
    stated += static_cast<double>(list[0].variance_x + list[0].variance_y);
    ++n;
  }
  // The filter expects more of vortices than moving straight on. Therefore the errors are below
  // what it states, and well below those of a single candidate.
  EXPECT_LT(std::sqrt(velocity_error2 / n), 0.035);  // pitches a frame, for 2-D vectors
  EXPECT_LT(position_error2, stated);
  EXPECT_GT(position_error2, 0.2 * stated);
  EXPECT_LT(std::sqrt(position_error2 / n), 0.7 * kErrorRms * std::sqrt(2.0));
}

TEST(VortexTracker, StatesItsErrors) {
  // The vortices move as the filter assumes, round a drift of .1. The squared errors over their
  // covariance are then those of χ² with two degrees of freedom, whose mean is 2.
  TrackerOptions options = independent_errors();
  constexpr int kVortices = 9, kFrames = 100, kTrials = 8;
  double sum = 0.0;
  int n = 0;
  for (int trial = 0; trial < kTrials; ++trial) {
    RandomStream random(3, static_cast<std::uint64_t>(trial));
    VortexTracker tracker(options, 60, 60, kCapacity);
    std::vector<std::array<double, 4>> truth;
    const double stays = std::exp(-1.0 / options.own_velocity_frames);
    for (int i = 0; i < kVortices; ++i)
      truth.push_back({8.0 + 15.0 * (i % 3), 8.0 + 15.0 * (i / 3),
                       0.1 + options.own_velocity * random.gaussian(),
                       options.own_velocity * random.gaussian()});
    for (int f = 0; f < kFrames; ++f) {
      std::vector<Vortex> candidates;
      for (auto& [x, y, vx, vy] : truth) {
        x += vx + options.wander * random.gaussian();
        y += vy + options.wander * random.gaussian();
        const double renewed = options.own_velocity * std::sqrt(1.0 - stays * stays);
        vx = 0.1 + stays * (vx - 0.1) + renewed * random.gaussian();
        vy = stays * vy + renewed * random.gaussian();
        // Compilers differ in which argument they make first.
        const double measured_y = y + kErrorRms * random.gaussian();
        const double measured_x = x + kErrorRms * random.gaussian();
        candidates.push_back(candidate(measured_x, measured_y, 1, 0.95));
      }
      const VortexList list = update(tracker, f, candidates);
      if (f < 40) continue;
      ASSERT_EQ(list.size(), std::size_t{kVortices});
      for (std::size_t i = 0; i < list.size(); ++i) {
        double ex = 100.0, ey = 100.0;
        // The nearest is unique, because vortices are 15 pitches apart.
        for (const auto& one : truth) {
          const double dx = static_cast<double>(list[i].x) - one[0];
          const double dy = static_cast<double>(list[i].y) - one[1];
          if (std::hypot(dx, dy) < std::hypot(ex, ey)) {
            ex = dx;
            ey = dy;
          }
        }
        const double xx = static_cast<double>(list[i].variance_x);
        const double yy = static_cast<double>(list[i].variance_y);
        const double xy = static_cast<double>(list[i].covariance_xy);
        sum += (ex * ex * yy + ey * ey * xx - 2.0 * ex * ey * xy) / (xx * yy - xy * xy);
        ++n;
      }
    }
    EXPECT_NEAR(static_cast<double>(tracker.drift()[0]) * kTrackFrameS, 0.1, 0.03);
    EXPECT_NEAR(static_cast<double>(tracker.drift()[1]) * kTrackFrameS, 0.0, 0.03);
  }
  // Errors last some 5 frames, so that about n/5 are independent. Their variance is 4, and the
  // tolerance is three σ.
  EXPECT_NEAR(sum / n, 2.0, 3.0 * 2.0 / std::sqrt(n / 5.0) + 0.1);
}

TEST(VortexTracker, OppositeOnesCrossAndStayWhoTheyAre) {
  VortexTracker tracker = make_tracker();
  RandomStream random(4, 0);
  std::set<std::int64_t> positive, negative;
  for (int f = 0; f < 60; ++f) {
    const VortexList list =
        update(tracker, f,
               {candidate(3.0 + 0.15 * f + 0.1 * random.gaussian(), 7.4, 1, 0.9),
                candidate(12.0 - 0.15 * f + 0.1 * random.gaussian(), 7.6, -1, 0.9)});
    for (const Vortex& vortex : list)
      (vortex.charge > 0 ? positive : negative).insert(vortex.track);
    if (f > 10) {
      EXPECT_EQ(list.size(), 2U) << "frame " << f;
    }
  }
  EXPECT_EQ(positive.size(), 1U);
  EXPECT_EQ(negative.size(), 1U);
  EXPECT_NE(*positive.begin(), *negative.begin());
}

TEST(VortexTracker, EqualOnesPassWithoutSwitching) {
  VortexTracker tracker = make_tracker();
  RandomStream random(5, 0);
  std::map<std::int64_t, double> last_x;
  for (int f = 0; f < 80; ++f) {
    const VortexList list =
        update(tracker, f,
               {candidate(3.0 + 0.12 * f + 0.1 * random.gaussian(), 6.9, 1, 0.9),
                candidate(12.6 - 0.12 * f + 0.1 * random.gaussian(), 8.1, 1, 0.9)});
    for (const Vortex& vortex : list) last_x[vortex.track] = static_cast<double>(vortex.x);
  }
  ASSERT_EQ(last_x.size(), 2U);
  // The first one has gone right and the second left.
  EXPECT_NEAR(last_x[0], 12.5, 0.5);
  EXPECT_NEAR(last_x[1], 3.1, 0.5);
}

TEST(VortexTracker, IdentitySurvivesMissedFrames) {
  VortexTracker tracker = make_tracker();
  RandomStream random(6, 0);
  std::set<std::int64_t> ids;
  int predicted = 0;
  for (int f = 0; f < 80; ++f) {
    std::vector<Vortex> candidates;
    const double x = 3.0 + 0.1 * f;
    const bool missed = f > 15 && f % 9 == 0;
    if (!missed) candidates.push_back(candidate(x + 0.1 * random.gaussian(), 7.5, 1, 0.98));
    const VortexList list = update(tracker, f, candidates);
    if (f <= 15) continue;
    ASSERT_EQ(list.size(), 1U) << "frame " << f;
    ids.insert(list[0].track);
    EXPECT_EQ((list[0].flags & kVortexPredicted) != 0, missed);
    EXPECT_NEAR(static_cast<double>(list[0].x), x, 0.4);
    predicted += missed ? 1 : 0;
  }
  EXPECT_EQ(ids.size(), 1U);
  EXPECT_EQ(predicted, 7);
}

TEST(VortexTracker, AVortexThatIsGoneIsForgottenAndItsNumberNotUsedAgain) {
  VortexTracker tracker = make_tracker();
  std::set<std::int64_t> ids;
  for (int life = 0; life < 3; ++life) {
    VortexList list(16);
    for (int f = 0; f < 20; ++f)
      list = update(tracker, 60 * life + f, {candidate(7.5, 7.5, -1, 0.95)});
    ASSERT_EQ(list.size(), 1U);
    EXPECT_TRUE(ids.insert(list[0].track).second);
    for (int f = 20; f < 60; ++f) list = update(tracker, 60 * life + f, {});
    EXPECT_TRUE(list.empty());
  }
  tracker.reset();
  VortexList list(16);
  for (int f = 0; f < 20; ++f) list = update(tracker, f, {candidate(7.5, 7.5, -1, 0.95)});
  ASSERT_EQ(list.size(), 1U);
  EXPECT_TRUE(ids.insert(list[0].track).second);
}

/// Returns the number of frames from the first candidate until there is a track.
int frames_to_confirm(bool with_partner, double x) {
  VortexTracker tracker = make_tracker();
  int f = 0;
  // A vortex that is there from the beginning does not count as a birth.
  for (; f < 3; ++f) update(tracker, f, {});
  for (int n = 1; n < 50; ++n, ++f) {
    std::vector<Vortex> candidates{candidate(x, 7.5, 1, 0.6)};
    if (with_partner) candidates.push_back(candidate(x, 8.5, -1, 0.6));
    for (const Vortex& vortex : update(tracker, f, candidates))
      if (vortex.charge > 0) return n;
  }
  return 50;
}

TEST(VortexTracker, BirthsInPairsAndAtTheEdgeAreSoonerBelieved) {
  TrackerOptions slow = independent_errors();
  EXPECT_LT(slow.lone_birth, 1.0);
  EXPECT_LE(frames_to_confirm(true, 7.5), frames_to_confirm(false, 7.5));
  EXPECT_LE(frames_to_confirm(false, 0.5), frames_to_confirm(false, 7.5));
  EXPECT_LT(frames_to_confirm(false, 7.5), 20);
}

/// Returns for how many frames a vortex is still reported after it was last seen.
int frames_to_forget(bool with_partner) {
  VortexTracker tracker = make_tracker();
  int f = 0;
  for (; f < 30; ++f) {
    std::vector<Vortex> candidates{candidate(7.5, 7.5, 1, 0.9)};
    if (with_partner) candidates.push_back(candidate(7.5, 8.2, -1, 0.9));
    update(tracker, f, candidates);
  }
  int frames = 0;
  while (frames < 50 && !update(tracker, f++, {}).empty()) ++frames;
  return frames;
}

TEST(VortexTracker, OppositeNeighboursAnnihilate) {
  EXPECT_LE(frames_to_forget(true), frames_to_forget(false));
  EXPECT_LT(frames_to_forget(false), 10);
}

TEST(VortexTracker, LeavesOverTheEdge) {
  VortexTracker tracker = make_tracker();
  VortexList list(16);
  for (int f = 0; f < 60; ++f) {
    const double x = 11.0 + 0.15 * f;
    std::vector<Vortex> candidates;
    if (x < 15.0) candidates.push_back(candidate(x, 7.5, 1, 0.95));
    list = update(tracker, f, candidates);
    if (x > 14.0 && x < 15.0) {
      EXPECT_EQ(list.size(), 1U);
    }
  }
  EXPECT_TRUE(list.empty());
}

TEST(VortexTracker, AnUnresolvedPairKeepsBothItsTracks) {
  const auto survivors = [](bool pair_seen) {
    VortexTracker tracker = make_tracker();
    for (int f = 0; f < 30; ++f)
      update(tracker, f, {candidate(7.5, 7.1, 1, 0.95), candidate(7.5, 7.9, -1, 0.95)});
    VortexList list(16);
    for (int f = 30; f < 38; ++f) {
      std::vector<Vortex> candidates;
      if (pair_seen) candidates.push_back(candidate(7.5, 7.5, 0, 0.9));
      list = update(tracker, f, candidates);
    }
    return list;
  };
  EXPECT_TRUE(survivors(false).empty());
  const VortexList kept = survivors(true);
  ASSERT_EQ(kept.size(), 2U);  // The pair itself is not reported a third time.
  for (const Vortex& vortex : kept) {
    EXPECT_NE(vortex.charge, 0);
    EXPECT_NE(vortex.flags & kVortexPredicted, 0U);
  }
  // A pair alone is passed on.
  VortexTracker tracker = make_tracker();
  const VortexList alone = update(tracker, 0, {candidate(7.5, 7.5, 0, 0.9)});
  ASSERT_EQ(alone.size(), 1U);
  EXPECT_EQ(alone[0].charge, 0);
  EXPECT_EQ(alone[0].track, -1);
}

/// Returns the number of tracks begun a frame where there is only clutter, which is all over and
/// new in every frame.
double false_tracks_per_frame(const TrackerOptions& options, double min_probability) {
  constexpr int kFrames = 4000;
  VortexTracker tracker(options, kTrackLenslets, kTrackLenslets, kCapacity);
  RandomStream random(7, 0);
  std::set<std::int64_t> ids;
  for (int f = 0; f < kFrames; ++f) {
    std::vector<Vortex> candidates;
    const double n = random.poisson(8.0);
    for (int i = 0; i < static_cast<int>(n); ++i) {
      candidates.push_back(candidate(15.0 * random.uniform(), 15.0 * random.uniform(),
                                     random.uniform() < 0.5 ? 1 : -1,
                                     min_probability * (1.0 + random.uniform())));
    }
    for (const Vortex& vortex : update(tracker, f, candidates)) ids.insert(vortex.track);
  }
  return static_cast<double>(ids.size()) / kFrames;
}

TEST(VortexTracker, FalseTracksStayBelowTheStatedRate) {
  TrackerOptions options = independent_errors();
  options.min_probability = 0.01;
  options.false_tracks_per_frame = 0.03;
  // This clutter is independent, so that all evidence may count. Then the rate comes near its
  // bound.
  options.evidence_weight = options.memory = 1.0;
  EXPECT_LT(false_tracks_per_frame(options, 0.02), 0.03);
  EXPECT_LT(false_tracks_per_frame(options, 0.1), 0.03);
  const double worst = false_tracks_per_frame(options, 0.3);
  EXPECT_LT(worst, 0.03 + 3.0 * std::sqrt(0.03 / 4000));
  EXPECT_GT(worst, 0.03 / 5.0);
  // With less weight, as real clutter demands, the rate is on the safe side.
  const TrackerOptions shipped;
  options.evidence_weight = shipped.evidence_weight;
  options.memory = shipped.memory;
  EXPECT_LT(false_tracks_per_frame(options, 0.3), worst);
}

TEST(VortexTracker, FaintOnesThatFollowOneAnotherMakeATrack) {
  // The candidates come in three of four frames and move steadily. A detector would hold each for
  // clutter.
  VortexTracker tracker = make_tracker();
  RandomStream random(8, 0);
  VortexList list(64);
  std::size_t reported = 0;
  for (int f = 0; f < 80; ++f) {
    std::vector<Vortex> candidates;
    if (f % 4 != 0)
      candidates.push_back(candidate(4.0 + 0.08 * f + kErrorRms * random.gaussian(),
                                     7.5 + kErrorRms * random.gaussian(), 1, 0.4));
    list = update(tracker, f, candidates);
    if (f >= 30) reported += list.size();
  }
  EXPECT_GT(reported, 10U);
}

TEST(VortexTracker, WithoutProbabilitiesSignificanceDecides) {
  const auto tracks = [](float significance) {
    VortexTracker tracker = make_tracker();
    VortexList list(16);
    for (int f = 0; f < 12; ++f) {
      Vortex vortex = candidate(7.5, 7.5, 1, 0.5);
      vortex.probability = kUnknownProbability;
      vortex.significance = significance;
      list = update(tracker, f, {vortex});
    }
    return list.size();
  };
  EXPECT_EQ(tracks(7.0F), 1U);
  EXPECT_EQ(tracks(1.0F), 0U);
}

TEST(VortexTracker, SingleDetectionsPassWhereAskedFor) {
  TrackerOptions options;
  options.min_probability_single = 0.8;
  VortexTracker tracker = make_tracker(options);
  const VortexList list =
      update(tracker, 0, {candidate(7.5, 7.5, 1, 0.99), candidate(3.5, 3.5, 1, 0.5)});
  ASSERT_EQ(list.size(), 1U);
  EXPECT_EQ(list[0].track, -1);
  EXPECT_GT(list[0].probability, 0.8F);
}

TEST(VortexTracker, MirroredChargesFlip) {
  VortexTracker plain = make_tracker();
  VortexTracker mirrored = make_tracker();
  RandomStream random(9, 0);
  std::size_t seen = 0;
  for (int f = 0; f < 60; ++f) {
    std::vector<Vortex> candidates, flipped;
    for (int i = 0; i < 4; ++i) {
      // These are multiples of 1/64, so that 15 − x is exact.
      const double noise = std::round(8.0 * random.gaussian()) / 64.0;
      const double x = 2.0 + 3.0 * i + f / 16.0 + noise;
      if (x < 0.0 || x > 15.0 || random.uniform() < 0.1) continue;
      candidates.push_back(candidate(x, 2.0 + 3.5 * i, i % 2 == 0 ? 1 : -1, 0.9));
      flipped.push_back(candidate(15.0 - x, 2.0 + 3.5 * i, i % 2 == 0 ? -1 : 1, 0.9));
    }
    const VortexList a = update(plain, f, candidates);
    const VortexList b = update(mirrored, f, flipped);
    ASSERT_EQ(a.size(), b.size()) << "frame " << f;
    for (std::size_t i = 0; i < a.size(); ++i) {
      EXPECT_EQ(a[i].charge, -b[i].charge);
      EXPECT_EQ(a[i].track, b[i].track);
      EXPECT_NEAR(a[i].x, 15.0F - b[i].x, 1e-3F);
      EXPECT_NEAR(a[i].velocity_x, -b[i].velocity_x, 0.1F);
    }
    seen += a.size();
  }
  EXPECT_GT(seen, 100U);
}

TEST(VortexTracker, RunsAlikeTwice) {
  const auto run = [] {
    TrackerOptions options;
    options.min_probability = options.min_probability_single = 0.05;
    VortexTracker tracker = make_tracker(options);
    RandomStream random(10, 0);
    std::vector<float> all;
    for (int f = 0; f < 100; ++f) {
      std::vector<Vortex> candidates;
      for (int i = 0; i < 30; ++i)
        candidates.push_back(candidate(15.0 * random.uniform(), 15.0 * random.uniform(),
                                       i % 2 == 0 ? 1 : -1, random.uniform()));
      for (const Vortex& vortex : update(tracker, f, candidates)) {
        all.push_back(vortex.x);
        all.push_back(static_cast<float>(vortex.track));
      }
    }
    return all;
  };
  const std::vector<float> first = run();
  EXPECT_GT(first.size(), 20U);
  EXPECT_EQ(first, run());
}

TEST(VortexTracker, CountsWhatFindsNoRoom) {
  VortexTracker tracker(independent_errors(), kTrackLenslets, kTrackLenslets, 3);
  std::vector<Vortex> candidates;
  for (int i = 0; i < 5; ++i) candidates.push_back(candidate(1.0 + 3.0 * i, 7.5, 1, 0.9));
  VortexList list(16);
  for (int f = 0; f < 15; ++f) list = update(tracker, f, candidates);
  EXPECT_EQ(list.size(), 3U);
  EXPECT_EQ(tracker.overflow(), 2 * 15);
  // The overflow of a detector's list that was too short stays counted.
  VortexList shortage(2);
  for (const Vortex& vortex : candidates) shortage.push(vortex);
  tracker.update(kTrackFrameS * 15, shortage);
  EXPECT_EQ(shortage.size(), 2U);
  EXPECT_GE(shortage.overflow(), 3);
}

// If a clock is too coarse for the frames, some frames have the time of the one before.
TEST(VortexTracker, TimeThatStandsStillForAFrameForgetsNothing) {
  VortexTracker tracker = make_tracker();
  std::int64_t track = -1;
  for (int frame = 0; frame < 40; ++frame) {
    const VortexList list =
        update(tracker, frame / 2 * 2, {candidate(5.0 + 0.02 * frame, 8.0, 1, 0.9)});
    if (frame < 20) continue;
    ASSERT_EQ(list.size(), 1U) << frame;
    if (track >= 0) {
      EXPECT_EQ(list[0].track, track) << frame;
    }
    track = list[0].track;
  }
  EXPECT_GE(track, 0);
}

TEST(VortexTracker, TimeThatGoesBackOrStopsForLongBeginsAnew) {
  for (const double jump : {-5.0, 100.0}) {
    VortexTracker tracker = make_tracker();
    VortexList list(16);
    for (int f = 0; f < 20; ++f) list = update(tracker, f, {candidate(7.5, 7.5, 1, 0.95)});
    ASSERT_EQ(list.size(), 1U);
    list.clear();
    list.push(candidate(7.5, 7.5, 1, 0.95));
    tracker.update(kTrackFrameS * (19.0 + jump), list);
    EXPECT_TRUE(list.empty()) << jump;
    for (int f = 0; f < 20; ++f) {
      list.clear();
      list.push(candidate(7.5, 7.5, 1, 0.95));
      tracker.update(kTrackFrameS * (20.0 + jump + f), list);
    }
    ASSERT_EQ(list.size(), 1U);
    EXPECT_EQ(list[0].track, 1);
  }
}

TEST(VortexTracker, RefusesOptionsWithoutSense) {
  const auto with = [](auto set) {
    TrackerOptions options;
    set(options);
    return VortexTracker(options, kTrackLenslets, kTrackLenslets, kCapacity);
  };
  EXPECT_THROW(with([](TrackerOptions& o) { o.false_tracks_per_frame = 0.0; }), UsageError);
  EXPECT_THROW(with([](TrackerOptions& o) { o.min_probability = 1.5; }), UsageError);
  EXPECT_THROW(with([](TrackerOptions& o) { o.memory = 0.0; }), UsageError);
  EXPECT_THROW(with([](TrackerOptions& o) { o.own_velocity_frames = -1.0; }), UsageError);
  EXPECT_THROW(with([](TrackerOptions& o) { o.wander = std::numeric_limits<double>::quiet_NaN(); }),
               UsageError);
}

}  // namespace
}  // namespace curlew
