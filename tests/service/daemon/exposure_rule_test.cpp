// The rule of exposure, tried on a source whose brightness is known.
#include "service/daemon/exposure_rule.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <vector>

#include "core/image.h"
#include "service/daemon/frame_brightness.h"

namespace curlew {
namespace {

struct Course {
  std::vector<double> changed_at_s;
  double exposure_us = 0.0;
  int reversals = 0;  ///< how often a change was taken back
};

/// Looks 25 times a second at a source that has the target's brightness at 1000 us where `light` is
/// 1. A change takes .1 s to be seen.
Course follow(double exposure_us, double seconds, const std::function<double(double)>& light) {
  constexpr double kStep_s = 0.04;
  constexpr double kLate_s = 0.1;
  ExposureRule rule({.target = 0.6, .min_us = 1.0, .max_us = 1e6});
  Course course;
  double seen_us = exposure_us, set_us = exposure_us, seen_at_s = 0.0;
  bool grew = false;
  for (double t = 0.0; t < seconds; t += kStep_s) {
    if (t >= seen_at_s) seen_us = set_us;
    const double brightness = std::min(0.6 * light(t) * seen_us / 1000.0, 1.0);
    const auto wanted = rule.look(t, brightness, set_us);
    if (!wanted) continue;
    const bool grows = *wanted > set_us;
    course.reversals += !course.changed_at_s.empty() && grows != grew ? 1 : 0;
    grew = grows;
    course.changed_at_s.push_back(t);
    set_us = *wanted;
    seen_at_s = t + kLate_s;
  }
  course.exposure_us = set_us;
  return course;
}

double steady(double) { return 1.0; }

TEST(ExposureRule, SettlesWithinTwoSecondsFromAHundredTimesTooMuchAndTooLittle) {
  for (const double factor : {100.0, 30.0, 7.0, 2.0, 0.5, 0.1, 0.03, 0.01}) {
    const Course course = follow(1000.0 * factor, 30.0, steady);
    ASSERT_FALSE(course.changed_at_s.empty()) << factor;
    EXPECT_LT(course.changed_at_s.back(), 2.0) << factor;
    EXPECT_LE(course.reversals, 1) << factor;
    EXPECT_GT(course.exposure_us, 600.0) << factor;
    EXPECT_LT(course.exposure_us, 1350.0) << factor;
  }
}

TEST(ExposureRule, LeavesAloneWhatIsRight) {
  for (const double light : {0.65, 1.0, 1.3})
    EXPECT_TRUE(follow(1000.0, 60.0, [=](double) { return light; }).changed_at_s.empty()) << light;
}

TEST(ExposureRule, AFlickeringSourceDoesNotMakeItHunt) {
  for (const double hz : {0.3, 1.0, 2.3, 7.0, 11.0}) {
    for (const double depth : {0.5, 0.9, 1.0}) {
      const auto light = [&](double t) { return std::fmod(t * hz, 1.0) < 0.5 ? 1.0 : 1.0 - depth; };
      const Course course = follow(300.0, 300.0, light);
      EXPECT_LT(course.changed_at_s.size(), 10U) << hz << " Hz, " << depth;
      EXPECT_LT(course.changed_at_s.back(), 60.0) << hz << " Hz, " << depth;
      EXPECT_GT(course.exposure_us, 600.0) << hz << " Hz, " << depth;
      EXPECT_LT(course.exposure_us, 1600.0) << hz << " Hz, " << depth;
    }
  }
}

TEST(ExposureRule, FollowsASourceThatGrowsAndFades) {
  const Course course = follow(1000.0, 400.0, [](double t) { return std::exp2(-t / 100.0); });
  EXPECT_GT(course.exposure_us * std::exp2(-4.0), 500.0);
  EXPECT_EQ(course.reversals, 0);
}

TEST(ExposureRule, StaysWithinItsLimits) {
  ExposureRule rule({.target = 0.6, .min_us = 50.0, .max_us = 2000.0});
  EXPECT_EQ(rule.look(0.0, 0.001, 1000.0), std::nullopt);
  EXPECT_EQ(rule.look(0.3, 0.001, 1000.0), 2000.0);
  EXPECT_EQ(rule.look(0.6, 0.001, 2000.0), std::nullopt);
  EXPECT_EQ(rule.look(0.9, 0.001, 2000.0), std::nullopt) << "there is nothing to change";
}

TEST(FrameBrightness, IsThatOfTheSpotsAndNotOfHotPixelsOrFewGlints) {
  constexpr int kSide = 120;
  Image<std::uint16_t> pixels(kSide, kSide, 100);
  const auto view = [&] {
    return FrameView{reinterpret_cast<const std::byte*>(pixels.data()), kSide, kSide,
                     PixelType::kU16};
  };
  for (int r = 6; r < kSide; r += 12)
    for (int c = 6; c < kSide; c += 12) {
      pixels(r, c) = 2100;
      pixels(r, c + 1) = pixels(r, c - 1) = pixels(r + 1, c) = pixels(r - 1, c) = 1100;
    }
  EXPECT_NEAR(frame_brightness(view(), 12.0, 4100.0), 0.5, 1e-9);
  for (int i = 1; i < 10; ++i) pixels(12 * i, 12 * i) = 4095;  // between the spots
  EXPECT_NEAR(frame_brightness(view(), 12.0, 4100.0), 0.5, 1e-9) << "hot pixels";
  pixels(18, 18) = pixels(18, 19) = 4095;
  EXPECT_NEAR(frame_brightness(view(), 12.0, 4100.0), 0.5, 1e-9) << "one bright spot";
}

}  // namespace
}  // namespace curlew
