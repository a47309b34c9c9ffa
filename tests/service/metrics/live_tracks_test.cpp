#include "service/metrics/live_tracks.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/support/allocation_counter.h"

namespace curlew {
namespace {

class LiveTracksTest : public ::testing::Test {
 protected:
  void frame(double time_s, const std::vector<std::int64_t>& numbers) {
    FrameHeader header;
    header.camera_ns = static_cast<std::int64_t>(std::llround(1e9 * time_s));
    VortexList vortices(1024);
    for (const std::int64_t number : numbers) {
      Vortex vortex;
      vortex.track = number;
      vortices.push(vortex);
    }
    EXPECT_EQ(allocations_of_this_thread([&] { tracks_.add(vortices, header); }), 0);
  }

  LiveTracks tracks_;
};

TEST_F(LiveTracksTest, CountTracksAndHowLongTheyLived) {
  frame(1.0, {7, -1});  // −1: not on a track
  frame(1.5, {7, 9});
  frame(2.0, {9});
  TracksSeen seen = tracks_.seen();
  EXPECT_EQ(seen.now, 1);
  EXPECT_EQ(seen.begun, 2);
  EXPECT_EQ(seen.ended, 1);
  EXPECT_DOUBLE_EQ(*seen.mean_life_s(), 0.5);
  frame(3.5, {9});
  frame(4.0, {});
  seen = tracks_.seen();
  EXPECT_EQ(seen.now, 0);
  EXPECT_EQ(seen.begun, 2);
  EXPECT_DOUBLE_EQ(*seen.mean_life_s(), (0.5 + 2.0) / 2.0);
}

TEST_F(LiveTracksTest, NothingIsSaidOfLivesBeforeOneHasEnded) {
  frame(1.0, {7});
  EXPECT_FALSE(tracks_.seen().mean_life_s());
}

TEST_F(LiveTracksTest, MoreTracksThanThereIsRoomForAreNotCounted) {
  std::vector<std::int64_t> many;
  for (std::int64_t i = 0; i < 1000; ++i) many.push_back(i);
  frame(1.0, many);
  EXPECT_EQ(tracks_.seen().now, static_cast<std::int64_t>(LiveTracks::kMost));
  frame(2.0, {3});
  EXPECT_EQ(tracks_.seen().now, 1);
  EXPECT_EQ(tracks_.seen().begun, static_cast<std::int64_t>(LiveTracks::kMost));
}

}  // namespace
}  // namespace curlew
