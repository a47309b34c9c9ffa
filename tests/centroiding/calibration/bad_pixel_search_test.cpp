#include "centroiding/calibration/bad_pixel_search.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "tests/centroiding/drawn_stack.h"

namespace curlew {
namespace {

/// Returns a stack of darks.
CalibrationInput darks(int frames, double step_adu = 0.0) {
  DrawnStack stack;
  stack.electrons = 0.0;
  stack.frames = frames;
  stack.step_adu = step_adu;
  return stack.draw();
}

TEST(BadPixelSearch, HotAndNoisyPixelsAndThoseDeadInTheFlatAreFound) {
  CalibrationInput stack = darks(20);
  // A slope across the detector is no reason.
  for (int r = 0; r < 128; ++r)
    for (int c = 0; c < 128; ++c) stack.reference_adu(r, c) += 0.5F * static_cast<float>(c);
  stack.reference_adu(5, 7) += 30.0F;               // noise of the mean: 3/√20 = .67
  stack.reference_adu(0, 0) += 30.0F;               // at the corner
  stack.reference_adu(9, 9) -= 30.0F;               // cold
  stack.reference_variance_adu2(40, 41) = 30 * 30;  // of 9
  stack.reference_adu(60, 60) = std::numeric_limits<float>::quiet_NaN();
  Image<float> flat(128, 128, 2.0F);
  for (int r = 0; r < 128; ++r)  // vignetting to a fifth in one corner
    for (int c = 0; c < 128; ++c) flat(r, c) *= 1.0F - 0.8F * static_cast<float>(r * c) / 16129.0F;
  flat(100, 100) *= 0.4F;
  flat(101, 20) = 0.0F;
  const BadPixels bad =
      find_bad_pixels(stack.reference_adu, stack.reference_variance_adu2, 20, flat);
  EXPECT_EQ(bad.hot, 3);
  EXPECT_EQ(bad.noisy, 1);
  EXPECT_EQ(bad.dead, 2);
  EXPECT_EQ(bad.no_number, 1);
  int marked = 0;
  for (const std::uint8_t b : bad.map) marked += b;
  EXPECT_EQ(marked, 7);
  for (const auto& [r, c] :
       {std::pair{5, 7}, {0, 0}, {9, 9}, {40, 41}, {60, 60}, {100, 100}, {101, 20}})
    EXPECT_EQ(bad.map(r, c), 1) << r << ", " << c;
}

TEST(BadPixelSearch, AGoodDetectorHasNone) {
  for (const int frames : {1, 2, 20}) {
    for (const double step : {0.0, 1.0, 8.0}) {  // 8: rounded to nearly nothing
      const CalibrationInput stack = darks(frames, step);
      const BadPixels bad =
          find_bad_pixels(stack.reference_adu, stack.reference_variance_adu2, frames, {});
      EXPECT_EQ(bad.hot + bad.noisy + bad.dead + bad.no_number, 0) << frames << ", " << step;
    }
  }
}

TEST(BadPixelSearch, CalibrationTakesPixelsFarBelowTheFlatAsBad) {
  CalibrationInput input = DrawnStack{}.draw();
  input.flat = Image<float>(128, 128, 1000.0F);
  input.flat(30, 30) = 100.0F;
  const Calibration calibration = calibrate_sensor(input);
  ASSERT_FALSE(calibration.sensor.bad_pixel.empty());
  EXPECT_EQ(calibration.sensor.bad_pixel(30, 30), 1);
  EXPECT_EQ(calibration.sensor.flat(31, 31), 1.0F);
}

// The flat's mean is that of the pixels that are left, so one absurd value must not be among them.
TEST(BadPixelSearch, AResponseThatIsAbsurdIsAsBadAsNone) {
  Image<float> flat(9, 9);
  flat.fill(1.0F);
  flat(4, 4) = 1e30F;
  flat(2, 7) = std::numeric_limits<float>::infinity();
  flat(7, 2) = 1e-30F;
  const Image<std::uint8_t> dead = find_dead_pixels(flat);
  EXPECT_EQ(std::count(dead.begin(), dead.end(), 1), 3);
  EXPECT_EQ(dead(4, 4) + dead(2, 7) + dead(7, 2), 3);
}

}  // namespace
}  // namespace curlew
