// A blur adds its variance to a spot's, and turned pixels see a spot turned; neither loses light.
#include "service/bench/field_light.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace curlew {
namespace {

/// Returns a Gaussian spot of unit sum, (x, y) px off the middle.
Image<float> spot(int side, double x, double y, double sigma) {
  Image<float> light(side, side);
  for (int row = 0; row < side; ++row) {
    for (int col = 0; col < side; ++col) {
      const double u = (col - 0.5 * (side - 1) - x) / sigma;
      const double v = (row - 0.5 * (side - 1) - y) / sigma;
      light(row, col) = static_cast<float>(std::exp(-0.5 * (u * u + v * v)) /
                                           (2.0 * std::numbers::pi * sigma * sigma));
    }
  }
  return light;
}

struct Moments {
  double sum = 0.0;
  double x = 0.0;  ///< off the middle
  double y = 0.0;
  double xx = 0.0;  ///< about the mean
};

Moments moments_of(const Image<float>& light) {
  Moments m;
  for (int row = 0; row < light.rows(); ++row) {
    for (int col = 0; col < light.cols(); ++col) {
      const auto value = static_cast<double>(light(row, col));
      const double x = col - 0.5 * (light.cols() - 1);
      m.sum += value;
      m.x += value * x;
      m.y += value * (row - 0.5 * (light.rows() - 1));
      m.xx += value * x * x;
    }
  }
  m.x /= m.sum;
  m.y /= m.sum;
  m.xx = m.xx / m.sum - m.x * m.x;
  return m;
}

TEST(FieldLight, ABlurAddsItsVariance) {
  for (const double sigma_px : {0.3, 0.8, 2.0}) {
    const Moments m = moments_of(blurred(spot(48, 1.0, -2.0, 1.5), sigma_px));
    EXPECT_NEAR(m.sum, 1.0, 5e-3) << sigma_px;  // The filter ends after some pixels.
    EXPECT_NEAR(m.x, 1.0, 1e-3) << sigma_px;
    EXPECT_NEAR(m.y, -2.0, 1e-3) << sigma_px;
    EXPECT_NEAR(m.xx, 1.5 * 1.5 + sigma_px * sigma_px, 0.08) << sigma_px;
  }
}

TEST(FieldLight, TurnedPixelsSeeATurnedSpot) {
  FieldParameters parameters;
  parameters.rows = parameters.cols = 1;
  parameters.window_px = 12;
  for (const double degrees : {0.0, 30.0, 90.0, -45.0}) {
    parameters.rotation_deg = degrees;
    const FieldParameters fine = before_turning(parameters);
    const double scale = fine.samples_per_lambda_w / parameters.samples_per_lambda_w;
    const double u = 2.0;  // px of the sensor
    const double v = 1.0;
    const Moments m =
        moments_of(turned(spot(fine.window_px, u * scale, v * scale, 1.2 * scale), parameters));
    const double angle = degrees * std::numbers::pi / 180.0;
    EXPECT_NEAR(m.sum, 1.0, 1e-2) << degrees;
    EXPECT_NEAR(m.x, std::cos(angle) * u - std::sin(angle) * v, 0.02) << degrees;
    EXPECT_NEAR(m.y, std::sin(angle) * u + std::cos(angle) * v, 0.02) << degrees;
  }
}

}  // namespace
}  // namespace curlew
