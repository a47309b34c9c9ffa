#include "service/air/air_watch.h"

#include <gtest/gtest.h>

#include <chrono>
#include <mutex>
#include <thread>
#include <vector>

#include "acquisition/simulator/simulator.h"
#include "service/air/air_json.h"
#include "tests/support/allocation_counter.h"
#include "tests/support/exact_sensor.h"

namespace curlew {
namespace {

constexpr std::int64_t kWindow = 6;  // frames; no clock is known

class AirWatchTest : public ::testing::Test {
 protected:
  static SimulatorOptions options() {
    SimulatorOptions options;
    options.rows = options.cols = 8;
    options.window_px = 8;
    options.frames = 3 * kWindow;
    options.photons = 500.0;
    return options;
  }

  /// Calls visit with the slot of each frame, a frame a second.
  template <typename Visit>
  void for_each_slot(const Visit& visit) {
    FrameBuffer frame(simulator_.format());
    FrameSlot slot(plan_);
    slot.frame = &frame;
    for (slot.frame_index = 0; simulator_.next(frame) == Delivery::kFrame; ++slot.frame_index) {
      frame.header.camera_ns = frame.header.received_ns = 0;
      frame.header.sequence = slot.frame_index;
      for (const Stage& stage : kStages) stage.run(plan_, slot);
      visit(slot);
    }
  }

  Simulator simulator_{options()};
  Plan plan_{sensor_of(simulator_, 8, 0.0), simulator_.format(), {}};
  AirOptions air_{static_cast<double>(kWindow), 0.0};
};

TEST_F(AirWatchTest, TellsWhatTheMeterMeasuresAndCostsTheFramePathNoMemory) {
  std::mutex mutex;
  std::vector<AirReport> told;
  std::vector<AirReport> measured;
  {
    AirWatch watch(plan_, air_, [&](const AirReport& report) {
      const std::lock_guard lock(mutex);
      told.push_back(report);
    });
    AirMeter meter(plan_, air_);
    AirSample sample = meter.make_sample();
    for_each_slot([&](const FrameSlot& slot) {
      EXPECT_EQ(allocations_of_this_thread([&] { watch.add(slot); }), 0);
      AirMeter::fill(slot, sample);
      if (const auto complete = meter.add(sample, slot.frame_index)) measured.push_back(*complete);
    });
  }
  ASSERT_EQ(measured.size(), 2U);
  ASSERT_EQ(told.size(), measured.size());
  for (std::size_t i = 0; i < told.size(); ++i) EXPECT_EQ(air_json(told[i]), air_json(measured[i]));
  EXPECT_EQ(air_json(told[1])["first_frame"], kWindow);
  EXPECT_EQ(air_json(told[1])["last_frame"], 2 * kWindow - 1);
  EXPECT_EQ(air_json(told[1])["frames"], kWindow);
  EXPECT_TRUE(air_json(told[1])["scintillation_index"]["value"].is_number());
  EXPECT_TRUE(air_json(told[1])["vortex_wind_x_pitches_per_s"]["value"].is_null());
}

TEST_F(AirWatchTest, AClockThatGoesBackBeginsAWindowAnew) {
  AirMeter meter(plan_, air_);
  AirSample sample = meter.make_sample();
  std::vector<AirReport> measured;
  for_each_slot([&](const FrameSlot& slot) {
    AirMeter::fill(slot, sample);
    // The clock of the first two frames is far ahead.
    if (slot.frame_index < 2) sample.time_s += 1e9;
    if (const auto complete = meter.add(sample, slot.frame_index)) measured.push_back(*complete);
  });
  ASSERT_EQ(measured.size(), 2U);
  EXPECT_EQ(measured[0].first_frame, 2);
  EXPECT_EQ(measured[0].last_frame, 1 + kWindow);
}

TEST_F(AirWatchTest, FramesOfAnotherSensorDoNotCount) {
  bool any = false;
  {
    Sensor other = sensor_of(simulator_, 8, 0.0);
    other.optics.pitch_m *= 2.0;
    const Plan plan(other, simulator_.format(), {});
    AirWatch watch(plan, air_, [&](const AirReport& /*report*/) { any = true; });
    for_each_slot([&](const FrameSlot& slot) { watch.add(slot); });
  }
  EXPECT_FALSE(any);
}

}  // namespace
}  // namespace curlew
