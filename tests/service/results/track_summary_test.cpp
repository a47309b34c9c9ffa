#include "service/results/track_summary.h"

#include <gtest/gtest.h>

#include <cmath>

namespace curlew {
namespace {

class TrackSummaryTest : public ::testing::Test {
 protected:
  void add(std::int64_t frame, double time_s, std::vector<Vortex> vortices) {
    FrameHeader header;
    header.camera_ns = static_cast<std::int64_t>(std::llround(1e9 * time_s));
    VortexList list(vortices.size());
    for (const Vortex& v : vortices) list.push(v);
    summary_.add(frame, header, list);
  }

  TrackSummary summary_;
};

Vortex vortex(std::int64_t track, float x, float y, int charge, std::uint32_t flags = 0) {
  return {.x = x, .y = y, .charge = charge, .probability = 0.5F, .flags = flags, .track = track};
}

TEST_F(TrackSummaryTest, AStraightTrackHasItsVelocityAndNoError) {
  for (int i = 0; i < 10; ++i) {
    const auto t = static_cast<float>(i);
    std::vector<Vortex> vortices{vortex(7, 1.0F + 0.25F * t, 6.0F - 0.5F * t, -1)};
    if (i == 4) vortices[0].flags = kVortexPredicted;  // where it was guessed to be does not count
    if (i == 4) vortices[0].x = 100.0F;
    vortices.push_back(vortex(-1, 2.0F, 2.0F, 1));  // belongs to no track
    add(20 + i, 1.0 + 0.01 * i, vortices);
  }
  const std::vector<TrackLife> tracks = summary_.tracks();
  ASSERT_EQ(tracks.size(), 1U);
  EXPECT_EQ(tracks[0].track, 7);
  EXPECT_EQ(tracks[0].charge, -1);
  EXPECT_EQ(tracks[0].first_frame, 20);
  EXPECT_EQ(tracks[0].last_frame, 29);
  EXPECT_EQ(tracks[0].sightings, 9);
  EXPECT_NEAR(tracks[0].life, 0.09, 1e-9);
  EXPECT_NEAR(tracks[0].velocity_x, 25.0, 1e-6);
  EXPECT_NEAR(tracks[0].velocity_y, -50.0, 1e-6);
  EXPECT_NEAR(tracks[0].error_velocity_x, 0.0, 1e-5);
  EXPECT_NEAR(tracks[0].probability, 0.5, 1e-6);
}

// A regular zigzag of ±a about a line of n places, spaced by 1: residuals of nearly a, so that the
// error is nearly a·√(n/(n − 2))/√(n(n² − 1)/12).
TEST_F(TrackSummaryTest, AScatteredTrackHasTheErrorOfItsScatter) {
  constexpr int kPlaces = 40;
  constexpr float kScatter = 0.1F;
  for (int i = 0; i < kPlaces; ++i)
    add(i, i,
        {vortex(0, 1.0F + 0.1F * static_cast<float>(i) + (i % 2 == 0 ? kScatter : -kScatter), 3.0F,
                1)});
  const TrackLife track = summary_.tracks().front();
  const double n = kPlaces;
  EXPECT_NEAR(track.error_velocity_x,
              0.1 * std::sqrt(n / (n - 2.0)) / std::sqrt(n * (n * n - 1.0) / 12.0), 3e-6);
  EXPECT_NEAR(track.velocity_x, 0.1, 3.0 * track.error_velocity_x);
}

TEST_F(TrackSummaryTest, OneSightingHasNoVelocity) {
  add(3, 1.0, {vortex(1, 2.0F, 2.0F, 1)});
  EXPECT_TRUE(std::isnan(summary_.tracks().front().velocity_x));
  add(4, 2.0, {vortex(1, 2.5F, 2.0F, 1)});
  EXPECT_NEAR(summary_.tracks().front().velocity_x, 0.5, 1e-6);
  EXPECT_TRUE(std::isnan(summary_.tracks().front().error_velocity_x));
}

TEST_F(TrackSummaryTest, TheTextShowsTheMostSeenAndCountsTheOthers) {
  EXPECT_EQ(summary_.text(3), "");
  for (int i = 0; i < 5; ++i) {
    std::vector<Vortex> vortices{vortex(11, 1.0F, 1.0F, 1)};
    if (i < 2) vortices.push_back(vortex(22, 5.0F, 5.0F, -1));
    add(i, i, vortices);
  }
  const std::string text = summary_.text(1);
  EXPECT_NE(text.find("    11     +1           0-4     5"), std::string::npos) << text;
  EXPECT_EQ(text.find("    22 "), std::string::npos) << text;
  EXPECT_NE(text.find("and 1 more tracks"), std::string::npos) << text;
}

}  // namespace
}  // namespace curlew
