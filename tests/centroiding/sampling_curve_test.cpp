// Spots smaller than a pixel are where they are, and not where their pixels draw them.
#include "centroiding/sampling_curve.h"

#include <gtest/gtest.h>

#include <cmath>

#include "centroiding/calibration/calibrate.h"
#include "tests/centroiding/drawn_stack.h"

namespace curlew {
namespace {

/// Returns the centre of gravity of a Gaussian at x that is integrated over pixels.
double centre_over_pixels(double x, double sigma) {
  double sum = 0.0;
  double sum_x = 0.0;
  for (int i = static_cast<int>(x) - 6; i <= static_cast<int>(x) + 7; ++i) {
    const double scale = sigma * std::sqrt(2.0);
    const double light = 0.5 * (std::erf((i + 0.5 - x) / scale) - std::erf((i - 0.5 - x) / scale));
    sum += light;
    sum_x += light * i;
  }
  return sum_x / sum;
}

TEST(SamplingCurve, TakesCentresOfGravityToWhereSpotsLie) {
  for (const double sigma : {0.25, 0.3, 0.4, 0.49}) {
    Sensor sensor;
    sensor.spot_gaussian_px = sigma;
    const SamplingCurve curve(sensor);
    ASSERT_FALSE(curve.empty());
    for (double x = 40.0; x < 42.0; x += 0.07) {
      const auto centre = static_cast<float>(centre_over_pixels(x, sigma));
      EXPECT_NEAR(curve.true_px(centre), x, 0.002) << "sigma " << sigma << " at " << x;
    }
  }
}

TEST(SamplingCurve, IsNotThereForSpotsThatNeedNone) {
  Sensor sensor;
  EXPECT_TRUE(SamplingCurve(sensor).empty()) << "nothing is known";
  sensor.spot_gaussian_px = 0.6;
  EXPECT_TRUE(SamplingCurve(sensor).empty());
  EXPECT_EQ(SamplingCurve(sensor).true_px(12.34F), 12.34F);
  // What it leaves uncorrected is what the header says.
  for (double x = 0.0; x < 1.0; x += 0.1)
    EXPECT_NEAR(centre_over_pixels(20.0 + x, 0.5), 20.0 + x, 0.003);
}

TEST(SamplingCurve, SigmaIsThatOfTheDrawnSpots) {
  for (const double sigma : {0.3, 0.4, 0.7}) {
    for (const double shift : {0.0, 0.2, 0.45}) {
      DrawnStack stack;
      stack.pitch_px = 8.0;
      stack.sigma_px = sigma;
      stack.shift_x_px = shift;
      stack.shift_y_px = -shift;
      const Sensor sensor = calibrate_sensor(stack.draw()).sensor;
      EXPECT_NEAR(sensor.spot_gaussian_px, sigma, 0.03) << sigma << " at " << shift;
    }
  }
  const Sensor wide = calibrate_sensor(DrawnStack{}.draw()).sensor;
  EXPECT_TRUE(std::isnan(wide.spot_gaussian_px)) << "1.5 px";
}

}  // namespace
}  // namespace curlew
