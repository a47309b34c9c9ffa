// A stage that is given buffers of another plan ends the program instead of writing beyond them.
#include <gtest/gtest.h>

#include "centroiding/centroid.h"
#include "centroiding/slopes.h"
#include "detect/circulation_finder.h"
#include "detect/whitened/whitened_finder.h"
#include "reconstruct/split.h"
#include "service/bench/bench_frames.h"

namespace curlew {
namespace {

class StageSizesDeathTest : public ::testing::Test {
 protected:
  const BenchCase case_{6, 7, 8};
  const Sensor sensor_ = tiled_sensor(case_);
  const BenchFrame frame_ = make_bench_frame(case_, BenchSlopes::kSmooth, 1);
  Centroids centroids_{6, 7};
  SlopeField slopes_{6, 7};
};

TEST_F(StageSizesDeathTest, CentroidsLookAtTheFrameAndTheirOwnMaps) {
  const CentroidPlan plan(sensor_, frame_.format, {});
  FrameView narrow = frame_.view();
  narrow.cols -= 1;
  EXPECT_DEATH(find_centroids(plan, narrow, centroids_), "a frame of 48 x 55 where 48 x 56");
  Centroids transposed(7, 6);
  EXPECT_DEATH(find_centroids(plan, frame_.view(), transposed), "7 x 6 where 6 x 7");
}

TEST_F(StageSizesDeathTest, SlopesLookAtCentroidsAndAtTheirOwnMaps) {
  const SlopePlan plan(sensor_);
  Centroids other(6, 6);
  EXPECT_DEATH(measure_weak_slopes(plan, other, slopes_), "centroids of 6 x 6 where 6 x 7");
  SlopeField small(5, 7);
  EXPECT_DEATH(measure_slopes(plan, centroids_, small), "slopes of 5 x 7 where 6 x 7");
  EXPECT_DEATH(leave_out_weak(centroids_, slopes_, small), "slopes of 5 x 7 where 6 x 7");
}

TEST_F(StageSizesDeathTest, DetectorsLookAtTheMap) {
  CirculationMap map(6, 6);
  EXPECT_DEATH(circulate(slopes_, map), "circulation of 5 x 5 where 5 x 6");
  VortexList vortices(10);
  EXPECT_DEATH(find_circulation_vortices(CirculationPlan({}, sensor_.valid, 10), map, vortices),
               "circulation of 5 x 5 where 5 x 6");
  const WhitenedPlan whitened({}, sensor_.valid, 10);
  WhitenedWorkspace workspace(whitened);
  EXPECT_DEATH(
      find_whitened_vortices(whitened, slopes_, centroids_.flux_adu, map, workspace, vortices),
      "circulation of 5 x 5 where 5 x 6");
}

TEST_F(StageSizesDeathTest, TheSplitLooksAtTheSlopes) {
  const SplitPlan plan(sensor_.valid, {});
  SplitWorkspace workspace(plan);
  HodgeSplit split(6, 7);
  EXPECT_DEATH(split_slopes(plan, SlopeField(7, 6), workspace, split),
               "slopes of 7 x 6 where 6 x 7");
}

}  // namespace
}  // namespace curlew
