// A daemon in the dark says so, and says when the light is back.
#include <gtest/gtest.h>

#include <thread>

#include "acquisition/simulator/simulator.h"
#include "service/daemon/daemon_status.h"
#include "service/daemon/status_printer.h"
#include "tests/support/exact_sensor.h"

namespace curlew {
namespace {

class NoLight : public ::testing::Test {
 protected:
  static SimulatorOptions options() {
    SimulatorOptions options;
    options.rows = options.cols = 8;
    options.window_px = 8;
    options.photons = 5000.0;
    options.frames = 100;
    return options;
  }

  /// Lets the daemon have results of a second and returns its status.
  StatusSnapshot second(bool dark) {
    const Plan plan(sensor_of(simulator_, 8, 100.0), simulator_.format(), Config{});
    WindowFollower follower(*plan.follower);
    FrameSlot slot(plan, &follower);
    FrameBuffer frame(simulator_.format());
    slot.frame = &frame;
    for (int i = 0; i < 2; ++i) {
      simulator_.next(frame);
      auto* pixels = reinterpret_cast<std::uint16_t*>(frame.data());
      if (dark) std::fill_n(pixels, simulator_.format().pixels(), std::uint16_t{100});
      for (const Stage& stage : kStages) stage.run(plan, slot);
      if (i > 0) std::this_thread::sleep_for(std::chrono::milliseconds(1050));
      status_.result_published(slot);
    }
    return status_.second_over();
  }

  Simulator simulator_{options()};
  DaemonStatus status_;
};

TEST_F(NoLight, IsAState) {
  status_.enter(DaemonState::kStreaming, "");
  const StatusSnapshot dark = second(true);
  EXPECT_EQ(dark.state, DaemonState::kNoLight);
  EXPECT_NE(status_json(dark, {}).find("\"state\":\"no light\""), std::string::npos)
      << status_json(dark, {});
  EXPECT_NE(status_fields(dark).find("state=no_light results=2"), std::string::npos);
  EXPECT_EQ(status_line(dark).rfind("no light", 0), 0U);
  const StatusSnapshot lit = second(false);
  EXPECT_EQ(lit.state, DaemonState::kStreaming);
  EXPECT_EQ(lit.window.valid_now, 64);
}

}  // namespace
}  // namespace curlew
