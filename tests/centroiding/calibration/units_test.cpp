// Nothing that calibration finds depends on the unit of the file, and the gain comes from the
// frames.
#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "centroiding/calibration/calibrate.h"
#include "centroiding/calibration/photon_transfer.h"
#include "tests/centroiding/drawn_stack.h"

namespace curlew {
namespace {

bool says(const Calibration& calibration, const std::string& words) {
  for (const std::string& note : calibration.notes) {
    if (note.find(words) != std::string::npos) return true;
  }
  return false;
}

TEST(Units, PhotonTransferTellsElectronsPerUnit) {
  for (const double e_per_adu : {0.0625, 1.0, 3.0, 65535.0}) {
    SCOPED_TRACE(e_per_adu);
    DrawnStack stack;
    stack.e_per_adu = e_per_adu;
    const CalibrationInput input = stack.draw();
    Image<float> light = input.reference_adu;
    for (float& v : light) v -= static_cast<float>(stack.bias_e / e_per_adu);
    const PhotonTransfer seen =
        measure_photon_transfer(light, input.reference_variance_adu2, stack.frames, {});
    // Some 3,000 lit pixels of 30 frames scatter by √(2/29/3000) = .5 %, and bins by 2 % each.
    EXPECT_NEAR(seen.e_per_adu / e_per_adu, 1.0, 0.05);
    EXPECT_NEAR(seen.noise_adu * e_per_adu, 3.0, 0.15);
    EXPECT_FALSE(seen.clipped);
  }
}

TEST(Units, DarkFramesTellNoGain) {
  DrawnStack stack;
  stack.electrons = 0.0;
  const CalibrationInput input = stack.draw();
  EXPECT_TRUE(
      std::isnan(measure_photon_transfer(input.reference_adu, input.reference_variance_adu2, 30, {})
                     .e_per_adu));
}

TEST(Units, TheSameFramesInAnyUnitGiveTheSameSensor) {
  DrawnStack stack;
  const Calibration counts = calibrate_sensor(stack.draw());
  for (const double e_per_adu : {65535.0, 100.0, 0.0625}) {
    SCOPED_TRACE(e_per_adu);
    stack.e_per_adu = e_per_adu;
    CalibrationInput input = stack.draw();
    input.adu_per_count = 1.0 / e_per_adu;
    const Calibration other = calibrate_sensor(input);
    ASSERT_EQ(other.sensor.valid.size(), counts.sensor.valid.size());
    EXPECT_NEAR(other.sensor.detector.e_per_adu / counts.sensor.detector.e_per_adu, e_per_adu,
                1e-3 * e_per_adu);
    EXPECT_NEAR(other.sensor.detector.read_noise_e, counts.sensor.detector.read_noise_e, 0.01);
    for (std::size_t k = 0; k < counts.sensor.valid.size(); ++k) {
      ASSERT_EQ(other.sensor.valid[k], 1);
      // Floats around a bias of 100 e⁻ round to 1e-5 e⁻, which is nothing beside a flux of 3,000.
      EXPECT_NEAR(other.sensor.gain_x[k], counts.sensor.gain_x[k], 1e-3);
      EXPECT_NEAR(other.sensor.ref_x_px[k], counts.sensor.ref_x_px[k], 1e-3);
    }
  }
}

TEST(Units, ASpotThatItsWindowHoldsHasAGainOfOne) {
  // The window is ±4 σ wide. What lies beyond is below the threshold.
  const Calibration calibration = calibrate_sensor(DrawnStack{}.draw());
  for (const float gain : calibration.sensor.gain_x) EXPECT_NEAR(gain, 1.0F, 0.01F);
}

TEST(Units, AGivenGainIsHonouredAndHeldAgainstTheFrames) {
  CalibrationInput input = DrawnStack{}.draw();
  input.detector.e_per_adu = 1.05;
  Calibration calibration = calibrate_sensor(input);
  EXPECT_EQ(calibration.sensor.detector.e_per_adu, 1.05);
  EXPECT_FALSE(says(calibration, "--e-per-adu"));
  input.detector.e_per_adu = 4.0;
  calibration = calibrate_sensor(input);
  EXPECT_EQ(calibration.sensor.detector.e_per_adu, 4.0);
  EXPECT_TRUE(says(calibration, "check --e-per-adu"));
}

TEST(Units, TheGainOfLeftJustifiedBitsIsThatOfAStep) {
  DrawnStack stack;
  stack.e_per_adu = 0.0625;
  stack.step_adu = 16.0;
  CalibrationInput input = stack.draw();
  input.value_step = 16;
  input.detector.e_per_adu = 1.0;
  const Calibration calibration = calibrate_sensor(input);
  EXPECT_EQ(calibration.sensor.detector.e_per_adu, 0.0625);
  EXPECT_TRUE(says(calibration, "multiples of 16"));
}

TEST(Units, EightBitsClippedAtZeroTellTheirGain) {
  DrawnStack stack;
  stack.e_per_adu = 3.0;
  stack.bias_e = -12.0;
  stack.read_noise_e = 4.5;
  stack.step_adu = 1.0;
  stack.lowest_adu = 0.0;
  stack.highest_adu = 255.0;
  const Calibration calibration = calibrate_sensor(stack.draw());
  EXPECT_TRUE(says(calibration, "clipped"));
  EXPECT_NEAR(calibration.sensor.detector.e_per_adu, 3.0, 0.3);
  // At the level of 0 counts 12 e⁻ of light reach the pixel: √(4.5² + 12)/3 = 1.9. That is an
  // extrapolation from brighter pixels.
  EXPECT_NEAR(calibration.sensor.detector.read_noise_e / 3.0, 1.9, 0.6);
  for (const std::uint8_t valid : calibration.sensor.valid) EXPECT_EQ(valid, 1);
}

TEST(Units, OneFrameOfFractionsTakesItsScaleFromTheNoise) {
  DrawnStack stack;
  stack.e_per_adu = 65535.0;
  stack.frames = 1;
  CalibrationInput input = stack.draw();
  input.adu_per_count = 1.0 / 65535.0;
  const Calibration calibration = calibrate_sensor(input);
  EXPECT_NEAR(calibration.sensor.detector.e_per_adu / 65535.0, 1.0, 0.2);
}

}  // namespace
}  // namespace curlew
