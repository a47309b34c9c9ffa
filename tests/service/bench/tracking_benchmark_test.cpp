#include "service/bench/tracking_benchmark.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "acquisition/simulator/random_stream.h"
#include "detect/tracking/vortex_tracker.h"
#include "service/bench/tracking_dataset.h"
#include "service/bench/tracking_score.h"
#include "tests/support/allocation_counter.h"

namespace curlew {
namespace {

constexpr Interior kInterior{16, 16};

SceneVortex scene(double x, double y, int charge) { return {x, y, charge, 0.0, 0.0}; }

TrueVortex truth(double x, double y, int charge, int identity) {
  return {.vortex = {x, y, charge, true, true}, .identity = identity};
}

Vortex found(double x, double y, int charge, double probability) {
  Vortex vortex;
  vortex.x = static_cast<float>(x);
  vortex.y = static_cast<float>(y);
  vortex.charge = charge;
  vortex.probability = static_cast<float>(probability);
  return vortex;
}

TrackingCounts sum(const std::vector<TrackingCounts>& frames) {
  TrackingCounts total;
  for (const TrackingCounts& frame : frames) total += frame;
  return total;
}

TEST(IdentifyVortices, FollowsThemAndMarksBirthsAndDeaths) {
  const std::vector<std::vector<SceneVortex>> steps{
      {scene(5, 5, 1)},
      {scene(5.2, 5, 1), scene(8, 8, 1), scene(8, 8.3, -1)},  // a pair is born
      {scene(8, 8.5, -1), scene(5.4, 5, 1), scene(8.1, 8, 1)},
      {scene(8, 8.7, -1), scene(5.6, 5, -1)},  // one died, and one of the other charge came
  };
  const auto ids = identify_vortices(steps);
  EXPECT_EQ(ids[0], (std::vector<int>{0}));
  EXPECT_EQ(ids[1], (std::vector<int>{0, 1, 2}));
  EXPECT_EQ(ids[2], (std::vector<int>{2, 0, 1}));
  EXPECT_EQ(ids[3], (std::vector<int>{2, 3}));
}

TEST(IdentifyVortices, GoesByWhereTheyShouldBe) {
  // Two of one charge meet head on, where the nearest from step to step would be the wrong one.
  std::vector<std::vector<SceneVortex>> steps;
  for (int i = 0; i < 6; ++i)
    steps.push_back({scene(4.0 + 0.4 * i, 5, 1), scene(6.1 - 0.4 * i, 5, 1)});
  const auto ids = identify_vortices(steps, 0.5);
  for (const auto& step : ids) EXPECT_EQ(step, (std::vector<int>{0, 1}));
}

TEST(TrueVortices, HaveVelocities) {
  std::vector<std::vector<SceneVortex>> steps;
  for (int i = 0; i < 6; ++i) steps.push_back({scene(4.0 + 0.1 * i, 5.0 - 0.05 * i, 1)});
  const auto frames = true_vortices(steps, 2);
  ASSERT_EQ(frames.size(), 3U);
  for (const auto& frame : frames) {
    ASSERT_EQ(frame.size(), 1U);
    EXPECT_EQ(frame[0].identity, 0);
    EXPECT_NEAR(frame[0].velocity_x, 0.2, 1e-12);  // a frame is two steps
    EXPECT_NEAR(frame[0].velocity_y, -0.1, 1e-12);
  }
}

TEST(ScoreTracks, CountsEachKindOfMistake) {
  std::vector<std::vector<TrueVortex>> frames(4, {truth(5, 5, 1, 7), truth(9, 9, -1, 8)});
  const std::vector<std::vector<ReportedVortex>> reported{
      {{5.3, 5, 1, 0}, {9, 9.4, -1, 1}},                // both hit
      {{5.3, 5, 1, 0}, {9, 9.4, -1, 2}},                // another track hits the second vortex
      {{5.3, 5, 1, 0}, {12, 3, 1, 3}},                  // the second is missed, and one is false
      {{5.3, 5, -1, 0}, {9, 9.4, -1, 2}, {0, 3, 1, 4}}  // a wrong charge, and one at the rim
  };
  const auto counts = score_tracks(frames, reported, kInterior);
  EXPECT_EQ(counts[1].switches, 1.0);
  EXPECT_EQ(counts[2].false_tracks, 1.0);
  const TrackingCounts total = sum(counts);
  EXPECT_EQ(total.frames, 4.0);
  EXPECT_EQ(total.required, 8.0);
  EXPECT_EQ(total.hits, 6.0);
  EXPECT_EQ(total.misses(), 2.0);
  EXPECT_EQ(total.false_alarms, 2.0);
  EXPECT_EQ(total.switches, 1.0);
  EXPECT_EQ(total.false_tracks, 1.0);
  EXPECT_NEAR(total.rms(), std::sqrt((3 * 0.09 + 3 * 0.16) / 6.0), 1e-12);
  EXPECT_NEAR(total.accuracy(), 1.0 - 5.0 / 8.0, 1e-12);
  // The first vortex's own track is 0, with three hits; the second's is 2, with two.
  EXPECT_EQ(total.consistent_hits, 5.0);
}

TEST(ScoreTracks, WhoHitItLastGoesFirst) {
  const std::vector<std::vector<TrueVortex>> frames(2, {truth(5, 5, 1, 0)});
  const auto counts = score_tracks(
      frames,
      std::vector<std::vector<ReportedVortex>>{{{5.1, 5, 1, 0}}, {{5.5, 5, 1, 0}, {5.0, 5, 1, 1}}},
      kInterior);
  EXPECT_EQ(counts[1].switches, 0.0);
  EXPECT_EQ(counts[1].false_alarms, 1.0);
}

TEST(LinkNearest, LinksWhatIsAboveTheThreshold) {
  const auto frames = link_nearest({{found(5, 5, 1, 0.9), found(8, 8, -1, 0.3)},
                                    {found(5.2, 5, 1, 0.6), found(5.1, 5, -1, 0.9)},
                                    {found(6.2, 5, 1, 0.9)}},
                                   0.5);
  ASSERT_EQ(frames[0].size(), 1U);
  ASSERT_EQ(frames[1].size(), 2U);
  EXPECT_EQ(frames[1][0].track, frames[0][0].track);
  EXPECT_NEAR(frames[1][0].velocity_x, 0.2, 1e-6);
  EXPECT_NE(frames[1][1].track, frames[0][0].track);
  EXPECT_TRUE(std::isnan(frames[1][1].velocity_x));
  EXPECT_NE(frames[2][0].track, frames[0][0].track);  // it moved farther than .75
}

TEST(Track, IsBetterThanLinkingWhereDetectionIsPoor) {
  // Four vortices drift and are seen in two frames of three, among clutter.
  constexpr std::uint64_t kSeed = 11;
  RandomStream random(kSeed, 0);
  std::vector<std::vector<SceneVortex>> steps;
  std::vector<std::vector<Vortex>> candidates;
  for (int f = 0; f < 120; ++f) {
    auto& step = steps.emplace_back();
    auto& frame = candidates.emplace_back();
    for (int i = 0; i < 4; ++i) {
      const double x = 1.5 + 0.08 * f, y = 2.0 + 3.5 * i;
      step.push_back(scene(x, y, i % 2 == 0 ? 1 : -1));
      if (random.uniform() < 0.67)
        frame.push_back(found(x + 0.25 * random.gaussian(), y + 0.25 * random.gaussian(),
                              step.back().charge, 0.3 + 0.6 * random.uniform()));
    }
    for (int i = 0; i < 3; ++i)
      frame.push_back(found(15.0 * random.uniform(), 15.0 * random.uniform(), i % 2 == 0 ? 1 : -1,
                            0.5 * random.uniform()));
  }
  const auto truths = true_vortices(steps, 1);
  const FieldParameters field;
  const TrackingCounts linked = sum(score_tracks(truths, link_nearest(candidates, 0.4), kInterior));
  TrackerOptions options;
  options.min_probability = 0.3;
  const TrackingCounts tracked =
      sum(score_tracks(truths, track(candidates, options, field), kInterior));
  EXPECT_GT(linked.switches, 0.0);
  EXPECT_LT(tracked.switches, linked.switches) << "seed " << kSeed;
  EXPECT_LT(tracked.misses(), linked.misses());
  EXPECT_LT(tracked.false_alarms, linked.false_alarms);
  EXPECT_LT(tracked.false_tracks, linked.false_tracks);
  EXPECT_LT(tracked.rms(), linked.rms());
  EXPECT_LT(tracked.velocity_rms(), linked.velocity_rms());
  EXPECT_GT(tracked.identity_f1(), linked.identity_f1());
}

TEST(ReadOrSimulate, ArraysSeePartsOfOneField) {
  SequenceParameters parameters;
  parameters.field.rows = parameters.field.cols = 4;
  parameters.field.window_px = 4;
  int parts = 0;
  const auto arrays = read_or_simulate(parameters, 5, 2, "", 1, [&] { ++parts; });
  EXPECT_EQ(parts, 1);
  ASSERT_EQ(arrays.size(), 4U);
  SequenceParameters whole = parameters;
  whole.field.rows = whole.field.cols = 8;
  whole.arrays = 1;
  const auto all = read_or_simulate(whole, 5, 2, "", 1, [] {});
  ASSERT_EQ(all.size(), 1U);
  for (std::size_t f = 0; f < 2; ++f) {
    ASSERT_EQ(arrays[3].light[f].rows(), 16);
    EXPECT_EQ(arrays[0].light[f](0, 0), all[0].light[f](0, 0));
    EXPECT_EQ(arrays[3].light[f](3, 5), all[0].light[f](19, 21));
    EXPECT_GT(arrays[3].light[f](3, 5), 0.0F);
  }
  EXPECT_NE(arrays[0].light[0](3, 5), arrays[0].light[1](3, 5));  // the field drifts
}

TEST(VortexTracker, AllocatesNothing) {
  if (!kCountsAllocations) GTEST_SKIP() << "the sanitizer owns malloc";
  VortexTracker tracker({}, 16, 16, 40);
  VortexList list(100);
  RandomStream random(12, 0);
  std::size_t reported = 0;
  const long allocated = allocations_of_this_thread([&] {
    for (int f = 0; f < 300; ++f) {
      list.clear();
      for (int i = 0; i < 6; ++i)
        list.push(found(2.0 + 2.0 * i, 5.0 + random.gaussian() * 0.2, i % 3 - 1, 0.9));
      for (int i = 0; i < 60; ++i)
        list.push(found(15.0 * random.uniform(), 15.0 * random.uniform(), i % 2 == 0 ? 1 : -1,
                        0.1 * random.uniform()));
      tracker.update(1e-3 * f, list);
      reported += list.size();
    }
  });
  EXPECT_EQ(allocated, 0);
  EXPECT_GT(reported, 300U);
  EXPECT_GT(tracker.overflow(), 0);
}

}  // namespace
}  // namespace curlew
