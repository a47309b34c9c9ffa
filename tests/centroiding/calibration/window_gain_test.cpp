// Window gains and their curves, for dense spots, whose light reaches beyond their windows.
#include "centroiding/calibration/window_gain.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/centroiding/drawn_stack.h"

namespace curlew {
namespace {

constexpr double kPitchPx = 5.3;
constexpr double kReachPx = 0.75;
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

/// Returns where a displacement of q_px in the window is, by the window's curve.
double by_curve(const GainCurve& curve, double q_px) {
  return q_px / curve.gain + (curve.bend2 + curve.bend3 * q_px) * q_px * q_px;
}

TEST(WindowGain, ItsCurveIsRightWhereverASpotLiesInItsWindow) {
  // Pitch and pixels have no common measure, so that references lie anywhere in their pixels. The
  // gain alone is wrong by up to a fifth of such displacements.
  const Image<float> reference = dense_spots(0.0);
  const SignalThreshold threshold{kThresholdAdu};
  int n = 0;
  for (int step = -8; step <= 8; ++step) {
    const double shift_px = 0.1 * step;
    const Image<float> moved = dense_spots(shift_px);
    for (int j = 2; j < kCount - 2; ++j) {
      const double spot_px = 0.5 * (kSidePx - 1) + kPitchPx * (j - 0.5 * (kCount - 1));
      const int start = static_cast<int>(std::lround(spot_px)) - 2;
      const double off_px = off_middle_px(spot_px, start, 5);
      if (std::abs(off_px + shift_px) > kReachPx) continue;
      const Window window{start, kSidePx / 2 - 2, 5, 5};
      const SpotRange range = range_of_spots(off_px, kReachPx);
      const GainCurve curve = curves_of_picture(reference, window, threshold, {}, range, range).x;
      const auto x_px = [&](const Image<float>& light) {
        return measure_window(light, {}, window, threshold, 0.0).x_px;
      };
      EXPECT_NEAR(by_curve(curve, x_px(moved) - x_px(reference)), shift_px, 0.015)
          << "reference " << off_px << " px off its window's middle";
      ++n;
    }
  }
  EXPECT_GT(n, 80);
}

}  // namespace
}  // namespace curlew
