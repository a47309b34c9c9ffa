// The window gain of dense spots, whose light reaches beyond their windows.
#include "centroiding/calibration/window_gain.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/centroiding/drawn_stack.h"

namespace curlew {
namespace {

constexpr double kPitchPx = 5.3;
constexpr double kThresholdAdu = 12.0;
constexpr int kCount = 13;
constexpr int kSidePx = 80;

Image<float> dense_spots(double shift_x_px) {
  const DrawnStack spots{.side_px = kSidePx,
                         .count = kCount,
                         .pitch_px = kPitchPx,
                         .sigma_px = 1.2,
                         .shift_x_px = shift_x_px};
  const Image<double> light = spots.light();
  Image<float> picture(light.rows(), light.cols());
  for (std::size_t i = 0; i < light.size(); ++i) picture[i] = static_cast<float>(light[i]);
  return picture;
}

TEST(WindowGain, IsRightOnTheWholeWithinHalfAPixel) {
  // Within the window a spot's centre of gravity is a cubic of its place. A single number cannot be
  // right everywhere, but it is wrong by no more than the half of the cubic's part.
  const Image<float> reference = dense_spots(0.0);
  for (const double shift_px : {-0.5, -0.4, -0.3, -0.2, -0.1, 0.1, 0.2, 0.3, 0.4, 0.5}) {
    const Image<float> moved = dense_spots(shift_px);
    double sum_px = 0.0;
    int n = 0;
    for (int i = 2; i < kCount - 2; ++i) {
      for (int j = 2; j < kCount - 2; ++j) {
        const auto start = [](int index) {
          return static_cast<int>(
                     std::lround(0.5 * (kSidePx - 1) + kPitchPx * (index - 0.5 * (kCount - 1)))) -
                 2;
        };
        const Window window{start(j), start(i), 5, 5};
        const SignalThreshold threshold{kThresholdAdu};
        const WindowGain gain = gain_of_picture(reference, window, threshold, {});
        const auto x_px = [&](const Image<float>& light) {
          return measure_window(light, {}, window, threshold, 0.0).x_px;
        };
        sum_px += (x_px(moved) - x_px(reference)) / gain.x;
        ++n;
      }
    }
    EXPECT_NEAR(sum_px / n / shift_px, 1.0, 0.04) << shift_px;
  }
}

}  // namespace
}  // namespace curlew
