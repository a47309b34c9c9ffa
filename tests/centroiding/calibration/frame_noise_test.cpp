#include "centroiding/calibration/frame_noise.h"

#include <gtest/gtest.h>

#include "service/bench/bench_frames.h"

namespace curlew {
namespace {

TEST(FrameNoise, OfFramesWhoseNoiseIsKnown) {
  // The noise is 3 ADU, with 1/12 ADU² for rounding. Differences are whole counts, and so is their
  // median; half a count of it is .5 ADU of noise. The spots of such windows do not reach the
  // corners.
  for (const BenchCase& which : {BenchCase{40, 40, 24}, BenchCase{30, 30, 32}}) {
    const BenchFrame frame = make_bench_frame(which, BenchSlopes::kRandom, 5);
    Sensor sensor = tiled_sensor(which);
    EXPECT_NEAR(estimate_frame_noise(sensor, frame.format, frame.view()).noise_adu, 3.01, 0.5);
    FrameFormat scaled = frame.format;
    scaled.scale_adu = 0.25;
    EXPECT_NEAR(estimate_frame_noise(sensor, scaled, frame.view()).noise_adu, 0.7525, 0.13);
    // A dark that the frame does not have adds its own 2 ADU.
    add_maps(sensor, 3);
    EXPECT_NEAR(estimate_frame_noise(sensor, frame.format, frame.view()).noise_adu, 3.61, 0.1);
  }
}

TEST(FrameNoise, TooFewPixelsTellNothing) {
  const BenchCase few{2, 2, 8};
  const BenchFrame frame = make_bench_frame(few, BenchSlopes::kRandom, 5);
  EXPECT_EQ(estimate_frame_noise(tiled_sensor(few), frame.format, frame.view()).noise_adu, 0.0);
}

}  // namespace
}  // namespace curlew
