#include "service/results/json_line.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "acquisition/simulator/simulator.h"
#include "service/results/frame_modes.h"
#include "service/results/wavefront_meter.h"
#include "tests/support/allocation_counter.h"
#include "tests/support/exact_sensor.h"

namespace curlew {
namespace {

class JsonLineTest : public ::testing::Test {
 protected:
  static constexpr double kTilt = 0.3;

  static SimulatorOptions options() {
    SimulatorOptions options;
    options.rows = options.cols = 8;
    options.window_px = 8;
    options.scene.tilt_x_rad = kTilt;
    options.photons = 0.0;  // no noise
    options.bias_adu = 0.0;
    return options;
  }
  JsonLineTest() {
    slot_.frame = &frame_;
    EXPECT_EQ(simulator_.next(frame_), Delivery::kFrame);
    for (const Stage& stage : kStages) stage.run(plan_, slot_);
    result_.copy(slot_, 0);
  }
  nlohmann::json line(const AirReport* air = nullptr) const {
    std::string text;
    append_json_line(result_, text, air);
    return nlohmann::json::parse(text);
  }

  Simulator simulator_{options()};
  Plan plan_{sensor_of(simulator_, 8, 0.0), simulator_.format(), {}};
  FrameBuffer frame_{simulator_.format()};
  FrameSlot slot_{plan_};
  FrameResult result_{8};
};

TEST_F(JsonLineTest, HasZernikesOnlyWhereTheyWereFitted) {
  EXPECT_FALSE(line().contains("zernike"));
  FrameModes modes(plan_);
  result_.zernike.reserve(kLastNoll);
  EXPECT_EQ(allocations_of_this_thread([&] { modes.fit(slot_, result_.zernike); }), 0);
  const nlohmann::json zernike = line()["zernike"];
  const ModePlan plan = modes_of(plan_.split);
  ASSERT_EQ(zernike.size(), static_cast<std::size_t>(plan.modes()));
  // Z2 is 2x/R, so a tilt of s rad a pitch has the coefficient s R/2. Spots cut off by their
  // windows make the measured tilt a few per cent less.
  EXPECT_NEAR(zernike[0].get<double>(), kTilt * plan.pupil().radius / 2.0, 0.05);
  for (std::size_t i = 1; i < zernike.size(); ++i)
    EXPECT_NEAR(zernike[i].get<double>(), 0.0, 0.02) << "Noll " << i + 2;
}

TEST_F(JsonLineTest, ZernikesOfAnotherSensorAreNotTold) {
  Sensor other = sensor_of(simulator_, 8, 0.0);
  other.optics.pitch_m *= 2.0;
  const Plan plan(other, simulator_.format(), {});
  FrameModes modes(plan);
  result_.zernike = {1.0F};
  modes.fit(slot_, result_.zernike);
  EXPECT_FALSE(line().contains("zernike"));
}

TEST_F(JsonLineTest, TellsOfTheAirWhereAWindowIsComplete) {
  EXPECT_FALSE(line().contains("air"));
  AirReport report;
  report.figures.frames = 500;
  report.figures.scintillation = {0.7, 0.01};
  report.without_r0 = "r0 is not told";
  const nlohmann::json air = line(&report)["air"];
  EXPECT_EQ(air["frames"], 500);
  EXPECT_EQ(air["scintillation_index"]["value"], 0.7);
  EXPECT_EQ(air["scintillation_index"]["error"], 0.01);
  EXPECT_TRUE(air["r0_pitches"]["value"].is_null());
  EXPECT_EQ(air["without_r0"], "r0 is not told");
}

}  // namespace
}  // namespace curlew
