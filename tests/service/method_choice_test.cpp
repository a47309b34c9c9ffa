// auto takes the best method that suits, and never the classifier where it was not taught.
#include "service/method_choice.h"

#include <gtest/gtest.h>

#include "acquisition/simulator/simulator.h"
#include "core/error.h"
#include "service/vortex_detection.h"
#include "tests/support/exact_sensor.h"

namespace curlew {
namespace {

class MethodChoiceTest : public ::testing::Test {
 protected:
  MethodChoiceTest() {
    config_.detect.method = DetectMethod::kAuto;
    still_ = config_;
    still_.centroid.follow_level = still_.centroid.follow_windows = false;
  }
  static SimulatorOptions options() {
    SimulatorOptions options;
    options.rows = options.cols = 8;
    options.window_px = 8;
    return options;
  }
  static bool says(const std::string& text, const std::string& words) {
    return text.find(words) != std::string::npos;
  }

  Simulator simulator_{options()};
  Sensor sensor_ = sensor_of(simulator_, 8, 100.0);
  Config config_;  ///< as shipped
  Config still_;   ///< says that level and windows stay
};

TEST_F(MethodChoiceTest, TheClassifierIsTakenOnlyForFramesThatAreAsCalibrated) {
  EXPECT_EQ(Config{}.detect.method, DetectMethod::kAuto);
  const MethodChoice choice = choose_method(sensor_, still_);
  EXPECT_EQ(choice.method, DetectMethod::kClassifier);
  EXPECT_TRUE(says(method_line(choice), "method classifier, chosen by auto")) << choice.why;
  EXPECT_TRUE(says(choice.why, "average precision .93 against .80")) << choice.why;
  EXPECT_EQ(choose_method(sensor_, config_).method, DetectMethod::kWhitened);
  EXPECT_TRUE(
      says(method_line(choose_method(sensor_, config_)), "method whitened, chosen by auto"));
  EXPECT_TRUE(says(choose_method(sensor_, config_).why, "two frames of real skies alone"));
  Config levels = still_;
  levels.centroid.follow_level = true;
  EXPECT_EQ(choose_method(sensor_, levels).method, DetectMethod::kWhitened);
  Config rate = still_;
  rate.detect.false_alarms_per_frame = 1e-4;
  EXPECT_EQ(choose_method(sensor_, rate).method, DetectMethod::kWhitened);
}

TEST_F(MethodChoiceTest, SpotsThatTheClassifierDoesNotKnowExcludeIt) {
  Sensor turned = sensor_;
  turned.grid.p21 = 0.2 * turned.grid.p11;
  EXPECT_EQ(choose_method(turned, still_).method, DetectMethod::kClassifier);
  Sensor blurred = sensor_;
  blurred.spot_blur_px = 1.5;  // .75 λ/w
  EXPECT_EQ(choose_method(blurred, still_).method, DetectMethod::kClassifier);
  blurred.spot_blur_px = 1.7;
  EXPECT_EQ(choose_method(blurred, still_).method, DetectMethod::kWhitened);
  EXPECT_TRUE(says(choose_method(blurred, still_).why, "blurred"));
  Sensor coarse = sensor_;
  coarse.optics.focal_m *= 0.5;  // 1 px a λ/w
  EXPECT_EQ(choose_method(coarse, still_).method, DetectMethod::kClassifier);
  coarse.optics.focal_m *= 0.8;
  EXPECT_EQ(choose_method(coarse, still_).method, DetectMethod::kWhitened);
  EXPECT_TRUE(says(choose_method(coarse, still_).why, "coarse"));
  // Who asks for it gets it with coarse pixels, but not with spots more blurred than it was taught.
  still_.detect.method = DetectMethod::kClassifier;
  EXPECT_EQ(choose_method(coarse, still_).method, DetectMethod::kClassifier);
  EXPECT_EQ(method_line(choose_method(coarse, still_)), "");
  EXPECT_THROW(choose_method(blurred, still_), UsageError);
}

TEST_F(MethodChoiceTest, WhatWasSetDecides) {
  config_.detect.min_circulation_rad = 2.0;
  EXPECT_EQ(choose_method(sensor_, config_).method, DetectMethod::kCirculation);
  Sensor strip = sensor_;
  strip.grid.rows = 3;
  EXPECT_EQ(choose_method(strip, Config{}).method, DetectMethod::kCirculation);
  const VortexDetectionPlan plan(sensor_, simulator_.format(), config_);
  EXPECT_EQ(plan.choice().method, DetectMethod::kCirculation);
  EXPECT_FALSE(plan.whitened());
}

TEST_F(MethodChoiceTest, SettingsWithoutEffectAreRefused) {
  const auto refused = [](DetectMethod method, void (*set)(DetectSettings&)) {
    Config config;
    config.detect.method = method;
    set(config.detect);
    try {
      refuse_settings_without_effect(config);
    } catch (const UsageError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  const auto rate = [](DetectSettings& d) { d.false_alarms_per_frame = 0.1; };
  const auto probability = [](DetectSettings& d) { d.min_probability = 0.7; };
  const auto review = [](DetectSettings& d) { d.review = false; };
  const auto lobe = [](DetectSettings& d) { d.lobe_fraction = 0.5; };
  EXPECT_TRUE(says(refused(DetectMethod::kClassifier, rate), "no effect on the method classifier"));
  EXPECT_EQ(refused(DetectMethod::kWhitened, rate), "");
  EXPECT_EQ(refused(DetectMethod::kCirculation, rate), "");
  EXPECT_TRUE(says(refused(DetectMethod::kCirculation, probability), "min_probability"));
  EXPECT_TRUE(says(refused(DetectMethod::kWhitened, review), "[detect] review"));
  EXPECT_EQ(refused(DetectMethod::kClassifier, review), "");
  EXPECT_EQ(refused(DetectMethod::kClassifier, probability), "");
  EXPECT_TRUE(says(refused(DetectMethod::kWhitened, lobe), "lobe_fraction"));
  EXPECT_EQ(refused(DetectMethod::kCirculation, lobe), "");
  for (const auto set : {+rate, +probability, +review, +lobe})
    EXPECT_EQ(refused(DetectMethod::kAuto, set), "");
}

TEST_F(MethodChoiceTest, FramesOfAnotherPixelFormatAreRefused) {
  sensor_.pixel_bits = 16;
  FrameFormat format = simulator_.format();
  ASSERT_EQ(format.pixel_type, PixelType::kU16);
  EXPECT_NO_THROW(CentroidPlan(sensor_, format));
  format.pixel_type = PixelType::kU8;
  try {
    const CentroidPlan plan(sensor_, format);
    FAIL();
  } catch (const Failure& failure) {
    EXPECT_TRUE(says(failure.what(), "8 bits")) << failure.what();
  }
  sensor_.pixel_bits = 0;
  EXPECT_NO_THROW(CentroidPlan(sensor_, format));
}

}  // namespace
}  // namespace curlew
