#include "centroiding/calibration/calibrate.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>

#include "core/error.h"
#include "tests/centroiding/drawn_spots.h"

namespace curlew {
namespace {

int overlap(int a, int an, int b, int bn) { return std::min(a + an, b + bn) - std::max(a, b); }

void expect_windows_apart(const Sensor& sensor) {
  for (std::size_t k = 0; k < sensor.window.size(); ++k) {
    for (std::size_t j = k + 1; j < sensor.window.size(); ++j) {
      const Window& a = sensor.window[k];
      const Window& b = sensor.window[j];
      if (a.w == 0 || b.w == 0) continue;
      EXPECT_LE(std::min(overlap(a.x0, a.w, b.x0, b.w), overlap(a.y0, a.h, b.y0, b.h)), 1)
          << "windows " << k << " and " << j;
    }
  }
}

/// Returns the centre of gravity of the light above the background in a window.
double centre_x(const Image<float>& image, const Window& w, double background) {
  double sum = 0.0;
  double moment = 0.0;
  for (int r = w.y0; r < w.y0 + w.h; ++r) {
    for (int c = w.x0; c < w.x0 + w.w; ++c) {
      const double light = std::max(static_cast<double>(image(r, c)) - background, 0.0);
      sum += light;
      moment += light * c;
    }
  }
  return moment / sum;
}

TEST(Calibrate, LaysAWindowOfOnePitchRoundEverySpot) {
  DrawnSpots drawn = drawn_without_gaps();
  CalibrationInput input;
  input.reference_adu = drawn.draw();
  const Sensor sensor = calibrate_sensor(input).sensor;
  ASSERT_EQ(sensor.grid.rows, 40);
  ASSERT_EQ(sensor.grid.cols, 40);
  for (int r = 0; r < 40; ++r) {
    for (int c = 0; c < 40; ++c) {
      const Window& w = sensor.window(r, c);
      ASSERT_EQ(w.w, 6);
      ASSERT_EQ(w.h, 6);
      ASSERT_EQ(w.x0, 6 * c);
      ASSERT_EQ(w.y0, 6 * r);
    }
  }
}

TEST(Calibrate, KeepsWindowsApartOnRotatedAndAberratedGrids) {
  for (const double rotation : {0.0, 20.0, -44.0}) {
    for (const double jitter : {0.0, 1.0}) {
      DrawnSpots drawn;
      drawn.rotation_deg = rotation;
      drawn.jitter_px = jitter;
      drawn.seed = 23;
      SCOPED_TRACE("rotation " + std::to_string(rotation) + " jitter " + std::to_string(jitter));
      CalibrationInput input;
      input.reference_adu = drawn.draw();
      const Sensor sensor = calibrate_sensor(input).sensor;
      expect_windows_apart(sensor);
      for (std::size_t k = 0; k < sensor.window.size(); ++k) {
        const Window& w = sensor.window[k];
        ASSERT_EQ(sensor.valid[k] != 0, w.w > 0);
        if (w.w == 0) continue;
        ASSERT_GE(w.x0, 0);
        ASSERT_GE(w.y0, 0);
        ASSERT_LE(w.x0 + w.w, sensor.frame_cols);
        ASSERT_LE(w.y0 + w.h, sensor.frame_rows);
        ASSERT_FALSE(std::isnan(sensor.ref_x_px[k]) || std::isnan(sensor.gain_y[k]));
      }
    }
  }
}

/// Draws 9×9 Gaussian spots 10 px apart, wings and all, moved by dx from the middles of their
/// cells.
Image<float> draw_wide_spots(double sigma_px, double dx) {
  constexpr int kCell = 10;
  constexpr int kSide = 130;
  Image<float> image(kSide, kSide, 100.0F);
  for (int r = 0; r < kSide; ++r) {
    for (int c = 0; c < kSide; ++c) {
      double along_x = 0.0;
      double along_y = 0.0;
      for (int k = 2; k < 11; ++k) {
        const double x = c - kCell * k - 0.5 * (kCell - 1) - dx;
        const double y = r - kCell * k - 0.5 * (kCell - 1);
        along_x += std::exp(-0.5 * x * x / (sigma_px * sigma_px));
        along_y += std::exp(-0.5 * y * y / (sigma_px * sigma_px));
      }
      image(r, c) += static_cast<float>(2000.0 * along_x * along_y);
    }
  }
  return image;
}

TEST(Calibrate, WindowGainIsWhatADisplacementIsMultipliedBy) {
  for (const double sigma_px : {1.0, 1.8, 2.2}) {
    SCOPED_TRACE("sigma " + std::to_string(sigma_px));
    CalibrationInput input;
    input.reference_adu = draw_wide_spots(sigma_px, 0.0);
    input.dark_adu = Image<float>(130, 130, 100.0F);
    input.detector.read_noise_e = 0.0;
    const Sensor sensor = calibrate_sensor(input).sensor;

    constexpr double kShift = 0.1;
    const Image<float> right = draw_wide_spots(sigma_px, kShift);
    const Image<float> left = draw_wide_spots(sigma_px, -kShift);
    int n = 0;
    for (std::size_t k = 0; k < sensor.valid.size(); ++k) {
      if (sensor.valid[k] == 0) continue;
      const Window& w = sensor.window[k];
      const double gain = (centre_x(right, w, 100.0) - centre_x(left, w, 100.0)) / (2.0 * kShift);
      // The spots are sampled here, and those of the model are integrated over pixels, which blurs
      // them by .29 px.
      EXPECT_NEAR(static_cast<double>(sensor.gain_x[k]), gain, 0.01);
      ++n;
    }
    EXPECT_EQ(n, 81);
  }
}

TEST(Calibrate, SaysWhatItHadToEstimate) {
  DrawnSpots drawn;
  drawn.pitch_px = 30.0;
  drawn.seed = 29;
  drawn.lit = [](double x, double y) { return std::hypot(x, y) < 100.0; };
  CalibrationInput input;
  input.reference_adu = drawn.draw();
  Calibration calibration = calibrate_sensor(input);
  EXPECT_EQ(calibration.notes.size(), 3U);  // They are about dark, e⁻ per ADU and read noise.
  // Some 5,000 pixels lie midway between spots. They give an error of 1.2 % for the scatter and of
  // 1.25·3/√5000 = .05 for the median. The limits are five σ.
  EXPECT_NEAR(calibration.sensor.detector.read_noise_e, 3.0, 0.2);
  EXPECT_EQ(calibration.sensor.detector.e_per_adu, 1.0);
  EXPECT_NEAR(calibration.sensor.background_adu, 100.0, 0.3);

  input.dark_adu = Image<float>(256, 256, 100.0F);
  input.dark_variance_adu2 = Image<float>(256, 256, 16.0F);
  input.detector.e_per_adu = 2.0;
  calibration = calibrate_sensor(input);
  EXPECT_EQ(calibration.notes.size(), 1U);
  EXPECT_DOUBLE_EQ(calibration.sensor.detector.read_noise_e, 8.0);  // This is √16 ADU of 2 e⁻.
  EXPECT_EQ(calibration.sensor.background_adu, 0.0);
}

TEST(Calibrate, FlatHasMeanOneAndItsDeadPixelsAreBad) {
  DrawnSpots drawn;
  CalibrationInput input;
  input.reference_adu = drawn.draw();
  input.flat = Image<float>(256, 256, 5.0F);
  input.flat(3, 4) = 0.0F;
  const Sensor sensor = calibrate_sensor(input).sensor;
  EXPECT_FLOAT_EQ(sensor.flat(10, 10), 1.0F);
  EXPECT_EQ(sensor.bad_pixel(3, 4), 1);
  EXPECT_EQ(sensor.bad_pixel(3, 5), 0);
}

TEST(Calibrate, RefusesMapsOfAnotherSize) {
  CalibrationInput input;
  input.reference_adu = DrawnSpots{}.draw();
  input.dark_adu = Image<float>(128, 256, 100.0F);
  EXPECT_THROW(calibrate_sensor(input), Failure);
}

}  // namespace
}  // namespace curlew
