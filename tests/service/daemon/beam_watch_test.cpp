// The daemon's beam: means of a second, and a warning that neither comes nor goes at a flicker.
#include "service/daemon/beam_watch.h"

#include <gtest/gtest.h>

#include <cmath>

#include "acquisition/simulator/simulator.h"
#include "service/daemon/daemon_status.h"
#include "service/daemon/status_printer.h"
#include "service/metrics/metrics_text.h"
#include "tests/support/allocation_counter.h"
#include "tests/support/exact_sensor.h"

namespace curlew {
namespace {

class BeamWatchTest : public ::testing::Test {
 protected:
  static constexpr int kSide = 16;
  static SimulatorOptions options() {
    SimulatorOptions options;
    options.rows = options.cols = kSide;
    options.window_px = 8;
    options.frames = 1;
    return options;
  }

  /// Gives the slot a Gaussian beam of 1/e² radius 3 at x in the middle row; 0 light for none.
  void shine(double x, float light = 1000.0F) {
    for (int row = 0; row < kSide; ++row)
      for (int col = 0; col < kSide; ++col) {
        const double r2 = std::pow(col - x, 2) + std::pow(row - 7.5, 2);
        const float flux = light * static_cast<float>(std::exp(-2.0 * r2 / 9.0));
        slot_.centroids.flux_adu(row, col) = flux;
        slot_.centroids.state(row, col) = flux > 0.5F ? LensletState::kValid : LensletState::kFaint;
      }
  }
  /// Lets a second pass with frames like this one.
  BeamReport second(double x, float light = 1000.0F) {
    for (int i = 0; i < 3; ++i) {
      shine(x, light);
      watch_.tap().offer(slot_);
      watch_.look();
    }
    const auto report = watch_.second_over(reference_);
    EXPECT_TRUE(report.has_value());
    return report.value_or(BeamReport{});
  }

  Simulator simulator_{options()};
  Plan plan_{sensor_of(simulator_, 8, 0.0), simulator_.format(), Config{}};
  FrameSlot slot_{plan_};
  BeamWatch watch_;
  BeamReference reference_;

  void SetUp() override {
    shine(7.5);
    reference_ = {measure_beam(slot_.centroids.flux_adu, slot_.centroids.state), 150e-6};
    watch_.tap().offer(slot_);
    watch_.look();  // now the sizes are known
  }
};

TEST_F(BeamWatchTest, TellsTheMeanOfASecond) {
  EXPECT_FALSE(watch_.second_over(reference_).has_value()) << "no frame has passed";
  for (const double x : {6.0, 9.0}) {
    shine(x);
    watch_.tap().offer(slot_);
    watch_.look();
  }
  const BeamReport report = watch_.second_over(reference_).value();
  EXPECT_NEAR(report.figures.x, 7.5, 1e-3);
  EXPECT_NEAR(report.figures.y, 7.5, 1e-3);
  EXPECT_NEAR(report.figures.d4sigma_x, 4.0 * std::sqrt(2.25 + 2.25), 0.1) << "two, 3 apart";
  EXPECT_EQ(report.warning, "");
}

TEST_F(BeamWatchTest, WarnsAfterThreeSecondsAndNotAtAFlicker) {
  EXPECT_EQ(second(1.0).warning, "");
  EXPECT_EQ(second(7.5).warning, "");
  EXPECT_EQ(second(1.0).warning, "");
  EXPECT_EQ(second(1.0).warning, "");
  EXPECT_EQ(second(1.0).warning, "the beam is cut at the left edge of the lenslets");
  EXPECT_EQ(second(7.5).warning, "the beam is cut at the left edge of the lenslets");
  EXPECT_EQ(second(14.0).warning, "the beam is cut at the right edge of the lenslets");
  const BeamReport gone = second(14.0, 0.0F);
  EXPECT_EQ(gone.warning, "the beam has left the lenslets over the right edge");
  EXPECT_FALSE(gone.figures.is_lit());
  for (int i = 0; i < 2; ++i) EXPECT_NE(second(7.5).warning, "") << i;
  EXPECT_EQ(second(7.5).warning, "");
  EXPECT_EQ(second(7.5, 0.0F).warning, "") << "the light went off in the middle";
}

TEST_F(BeamWatchTest, AskedOrNotAFrameAllocatesNothing) {
  if (!kCountsAllocations) GTEST_SKIP() << "the sanitizer owns malloc";
  shine(7.5);
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(allocations_of_this_thread([&] { watch_.tap().offer(slot_); }), 0);
    if (i == 1) watch_.look();
  }
}

TEST_F(BeamWatchTest, StatusLineJsonAndMetricsSayTheSame) {
  StatusSnapshot status;
  status.beam = BeamReport{.figures = reference_.figures, .pitch_m = 150e-6, .warning = "W"};
  const std::string json = status_json(status, {});
  EXPECT_NE(json.find("\"beam\":{\"x\":7.5"), std::string::npos) << json;
  EXPECT_NE(json.find("\"warning\":\"W\""), std::string::npos) << json;
  EXPECT_NE(status_line(status).find("W"), std::string::npos);
  const std::string line = beam_line(*status.beam);
  EXPECT_EQ(line.rfind("beam at x 7.50, y 7.50, D4σ 5.9", 0), 0U) << line;
  EXPECT_NE(line.find(" mm), 0 % at the rim; W"), std::string::npos) << line;
  const std::string metrics = metrics_text({}, status);
  EXPECT_NE(metrics.find("curlew_beam{figure=\"x_lenslets\"} 7.5"), std::string::npos);
  EXPECT_NE(metrics.find("curlew_beam_cut 1"), std::string::npos);
  status.beam = BeamReport{.figures = {}, .warning = ""};
  EXPECT_EQ(beam_line(*status.beam), "no beam: no lenslet has light");
  EXPECT_EQ(metrics_text({}, status).find("curlew_beam{"), std::string::npos);
  EXPECT_NE(status_json(status, {}).find("no lenslet has light"), std::string::npos);
}

}  // namespace
}  // namespace curlew
