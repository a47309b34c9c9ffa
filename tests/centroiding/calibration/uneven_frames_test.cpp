// Uneven light, overscan, hot pixels and dense spots are found and measured without bias.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "centroiding/calibration/calibrate.h"
#include "centroiding/calibration/spot_picture.h"
#include "tests/centroiding/drawn_stack.h"

namespace curlew {
namespace {

TEST(UnevenFrames, OverscanGlowAndHotPixelsHideNoLenslet) {
  for (unsigned seed = 1; seed <= 4; ++seed) {
    SCOPED_TRACE(seed);
    DrawnStack stack;
    stack.side_px = 160;
    stack.frames = 1;
    stack.seed = seed;
    stack.read_noise_e = 6.0;
    CalibrationInput input = stack.draw();
    Image<float>& frame = input.reference_adu;
    for (int r = 0; r < 160; ++r) {
      for (int c = 0; c < 160; ++c) {
        frame(r, c) += static_cast<float>(
            300.0 * std::exp(-((c - 90.0) * (c - 90.0) + (r - 110.0) * (r - 110.0)) / 8000.0));
        if (c < 9) frame(r, c) = -5000.0F;
        if (c >= 152) frame(r, c) = -4000.0F;
      }
    }
    std::mt19937 random(seed);
    std::uniform_int_distribution<int> at(0, 159);
    for (int i = 0; i < 25; ++i) frame(at(random), at(random)) = 59000.0F;
    const Calibration calibration = calibrate_sensor(input);
    const Sensor& sensor = calibration.sensor;
    EXPECT_NEAR(sensor.grid.pitch_px(), 12.0, 0.05);
    ASSERT_EQ(sensor.grid.rows, 9);
    ASSERT_EQ(sensor.grid.cols, 9);
    int n = 0;
    for (std::size_t k = 0; k < sensor.valid.size(); ++k) {
      n += sensor.valid[k];
      if (sensor.valid[k] == 0) continue;
      const double x = 79.5 + 12.0 * (static_cast<int>(k % 9) - 4);
      // A bad pixel in the middle of a spot costs it .2 px.
      EXPECT_NEAR(static_cast<double>(sensor.ref_x_px[k]), x, 0.3);
    }
    EXPECT_GE(n, 80);
    EXPECT_EQ(sensor.bad_pixel(80, 3), 1);
    EXPECT_EQ(sensor.bad_pixel(80, 155), 1);
    EXPECT_EQ(sensor.bad_pixel(12, 12), 0);
  }
}

TEST(UnevenFrames, BordersAreFoundAndNothingElse) {
  const CalibrationInput input = DrawnStack{}.draw();
  EXPECT_TRUE(find_borders(input.reference_adu, {}).empty());
  Image<float> frame = input.reference_adu;
  for (int c = 0; c < 128; ++c) frame(0, c) = frame(1, c) = 30000.0F;
  const Image<std::uint8_t> border = find_borders(frame, {});
  ASSERT_FALSE(border.empty());
  EXPECT_EQ(border(1, 64), 1);
  EXPECT_EQ(border(2, 64), 0);
}

/// Returns the displacement along x in px that the centre of gravity above the sensor's threshold
/// shows by the window's curve. It is the mean over the lenslets whose spots are, both times, where
/// the windows that follow would have them.
double measured_shift(const Sensor& sensor, const Image<float>& reference,
                      const Image<float>& moved) {
  const double threshold = sensor.background_adu + 4.0 * sensor.detector.read_noise_e;
  const auto centre = [&](const Image<float>& image, const Window& w) {
    double sum = 0.0;
    double at = 0.0;
    for (int r = w.y0; r < w.y0 + w.h; ++r) {
      for (int c = w.x0; c < w.x0 + w.w; ++c) {
        const double light = std::max(static_cast<double>(image(r, c)) - threshold, 0.0);
        sum += light;
        at += light * c;
      }
    }
    return at / sum;
  };
  double sum = 0.0;
  int n = 0;
  for (std::size_t k = 0; k < sensor.valid.size(); ++k) {
    const Window& w = sensor.window[k];
    const double q = centre(moved, w) - centre(reference, w);
    const double off_px = off_middle_px(static_cast<double>(sensor.ref_x_px[k]), w.x0, w.w);
    const auto of = [&](const Image<float>& map) { return static_cast<double>(map[k]); };
    if (std::abs(off_px + q) > 0.6 * curve_reach_px(sensor)) continue;
    sum += q / of(sensor.gain_x) + (of(sensor.bend2_x) + of(sensor.bend3_x) * q) * q * q;
    ++n;
  }
  EXPECT_GT(n, 100);
  return sum / n;
}

TEST(UnevenFrames, DenseSpotsAreMeasuredWithoutBias) {
  DrawnStack stack;
  stack.count = 20;
  stack.pitch_px = 5.3;
  stack.sigma_px = 1.2;
  CalibrationInput input = stack.draw();
  input.detector.e_per_adu = 1.0;
  const Sensor sensor = calibrate_sensor(input).sensor;
  for (const double shift : {-0.6, -0.3, 0.3, 0.6}) {
    SCOPED_TRACE(shift);
    DrawnStack moved = stack;
    moved.shift_x_px = shift;
    moved.seed = 2;
    EXPECT_NEAR(measured_shift(sensor, input.reference_adu, moved.draw().reference_adu), shift,
                0.01 * std::abs(shift) + 0.002);
  }
}

}  // namespace
}  // namespace curlew
