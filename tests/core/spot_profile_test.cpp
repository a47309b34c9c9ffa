// The core of a spot tells its width, wherever the spot lies.
#include "core/spot_profile.h"

#include <gtest/gtest.h>

#include <cmath>

namespace curlew {
namespace {

TEST(SpotCore, OfAGaussianFollowsFromTheProductOfGaussians) {
  constexpr double kSigma = 0.6;
  constexpr double kStep = 0.01;
  for (const double width : {0.2, 0.5, 1.3}) {
    for (const double place : {0.0, 0.3, -0.9}) {
      CoreSums sums;
      for (double x = -6.0; x < 6.0; x += kStep) {
        const double u = (x - place) / width;
        sums.add(std::exp(-0.5 * u * u), x, kSigma);
      }
      const double expected = 1.0 / (1.0 / (width * width) + 1.0 / (kSigma * kSigma));
      EXPECT_NEAR(sums.variance(), expected, 1e-6) << width << " at " << place;
    }
  }
  EXPECT_TRUE(std::isnan(CoreSums().variance()));
}

TEST(SpotCore, GrowsWithBlurAndHardlyWithNeighbours) {
  constexpr double kLambdaW = 2.0;  // px
  double before = 0.0;
  for (const double blur : {0.0, 0.2, 0.4, 0.6, 0.8}) {
    const SpotProfile profile(kLambdaW, blur * kLambdaW);
    const double variance = core_variance(profile, kLambdaW, -4.5, 10);
    EXPECT_GT(variance, before + 0.01);
    EXPECT_NEAR(core_variance(profile, kLambdaW, -4.5, 10, 12.0), variance, 0.02);
    before = variance;
  }
}

}  // namespace
}  // namespace curlew
