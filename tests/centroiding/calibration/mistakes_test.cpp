// Mistakes of the user's own are refused or said: optics that contradict the frame, overexposure,
// and darks that are lit.
#include <gtest/gtest.h>

#include <string>

#include "centroiding/calibration/calibrate.h"
#include "centroiding/calibration/dark_check.h"
#include "centroiding/calibration/optics_check.h"
#include "core/error.h"
#include "tests/centroiding/drawn_stack.h"

namespace curlew {
namespace {

/// Returns optics with a pitch of 12 px, and spots of σ = 1.5 px if d is about 3.5 px.
Optics optics_of_12_px() {
  Optics optics;
  optics.pitch_m = 120e-6;
  optics.pixel_m = 10e-6;
  optics.wavelength_m = 633e-9;
  optics.focal_m = 5e-3;
  return optics;
}

std::string refusal(const CalibrationInput& input) {
  try {
    calibrate_sensor(input);
    return {};
  } catch (const Failure& failure) {
    return failure.what();
  }
}

TEST(Mistakes, APitchThatContradictsTheOpticsIsRefused) {
  EXPECT_TRUE(check_pitch(optics_of_12_px(), 12.3).empty());
  ASSERT_EQ(check_pitch(optics_of_12_px(), 12.5).size(), 1U);
  EXPECT_NE(check_pitch(optics_of_12_px(), 12.5)[0].find("should be 12 px"), std::string::npos);
  EXPECT_THROW(check_pitch(optics_of_12_px(), 15.0), Failure);
  EXPECT_THROW(check_pitch(optics_of_12_px(), 9.0), Failure);
  EXPECT_THROW(check_pitch(optics_of_12_px(), 12000.0), Failure);
  // Binning that nobody mentioned is said loudly.
  EXPECT_EQ(check_pitch(optics_of_12_px(), 6.0).size(), 1U);
  EXPECT_TRUE(check_pitch(Optics{}, 6.0).empty());
}

TEST(Mistakes, AFocalLengthThatMakesSpotsImpossiblyNarrowIsRefused) {
  CalibrationInput input = DrawnStack{}.draw();
  input.optics = optics_of_12_px();
  const Calibration calibration = calibrate_sensor(input);
  // Diffraction gives σ = .42·2.64 px, and the spots have 1.5 px.
  EXPECT_NEAR(calibration.width_over_diffraction, 1.5 / 1.11, 0.15);
  input.optics.focal_m = 50e-3;
  EXPECT_NE(refusal(input).find("--focal-mm"), std::string::npos) << refusal(input);
  input.optics.focal_m = 5e-3;
  input.optics.wavelength_m = 6330e-9;
  EXPECT_NE(refusal(input).find("--wavelength-nm"), std::string::npos) << refusal(input);
}

TEST(Mistakes, AnOverexposedReferenceIsRefused) {
  DrawnStack stack;
  stack.electrons = 20000.0;
  stack.step_adu = 1.0;
  stack.highest_adu = 1000.0;  // The peaks have 1,400.
  EXPECT_NE(refusal(stack.draw()).find("81 of 81 spots of the reference are saturated at 1000"),
            std::string::npos);
  stack.frames = 1;
  EXPECT_NE(refusal(stack.draw()).find("saturated"), std::string::npos);
  stack.highest_adu = 4095.0;
  EXPECT_EQ(refusal(stack.draw()), "");
  // In 8 bits many pixels hold the same value by chance.
  stack.electrons = 3000.0;
  stack.e_per_adu = 5.0;
  EXPECT_EQ(refusal(stack.draw()), "");
}

TEST(Mistakes, ADarkThatIsLitIsRefused) {
  DrawnStack stack;
  CalibrationInput lit = stack.draw();
  DarkFrame dark = measure_dark(lit.reference_adu, lit.reference_variance_adu2, stack.frames);
  EXPECT_NE(find_light_in_dark(lit.reference_adu, dark).find("grid"), std::string::npos);
  stack.electrons = 0.0;
  CalibrationInput unlit = stack.draw();
  dark = measure_dark(unlit.reference_adu, unlit.reference_variance_adu2, stack.frames);
  EXPECT_EQ(find_light_in_dark(unlit.reference_adu, dark), "");
  EXPECT_NEAR(dark.level_adu, 100.0, 0.1);
  EXPECT_NEAR(dark.noise_adu, 3.0, 0.1);
  for (int r = 0; r < 128; ++r) {
    for (int c = 0; c < 128; ++c) unlit.reference_adu(r, c) += static_cast<float>(2 * c);
  }
  EXPECT_NE(find_light_in_dark(unlit.reference_adu, dark).find("varies"), std::string::npos);
}

}  // namespace
}  // namespace curlew
