#include "service/daemon/frame_snapshot.h"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>
#include <vector>

#include "acquisition/fits/fits_file.h"
#include "acquisition/simulator/simulator.h"
#include "tests/support/allocation_counter.h"
#include "tests/support/exact_sensor.h"
#include "tests/support/scratch_directory.h"

namespace curlew {
namespace {

using namespace std::chrono_literals;

class FrameSnapshotTest : public ::testing::Test {
 protected:
  static SimulatorOptions options() {
    SimulatorOptions options;
    options.rows = options.cols = 8;
    options.window_px = 8;
    options.frames = 4;
    options.scene.tilt_x_rad = 0.3;
    return options;
  }
  std::shared_ptr<const Plan> plan() {
    return std::make_shared<const Plan>(sensor_of(simulator_, 8, 0.0), simulator_.format(),
                                        Config{});
  }
  std::unique_ptr<FrameSlot> measured(const Plan& plan, FrameBuffer& frame) {
    auto slot = std::make_unique<FrameSlot>(plan);
    slot->frame = &frame;
    EXPECT_EQ(simulator_.next(frame), Delivery::kFrame);
    for (const Stage& stage : kStages) stage.run(plan, *slot);
    return slot;
  }

  Simulator simulator_{options()};
};

TEST_F(FrameSnapshotTest, ItsFileHoldsTheFrameAndItsResults) {
  const auto plan = this->plan();
  FrameBuffer frame(simulator_.format());
  const auto measured_slot = measured(*plan, frame);
  const FrameSlot& slot = *measured_slot;
  FrameSnapshot snapshot(plan, simulator_.format());
  SnapshotExchange exchange;
  std::atomic<bool> taken{false};
  std::thread publishes([&] {
    while (!taken) exchange.offer(slot);
  });
  EXPECT_TRUE(exchange.wait(snapshot, 10s));
  taken = true;
  publishes.join();

  const ScratchDirectory folder;
  write_bytes(folder / "snapshot.fits", snapshot.file());
  FitsFile file = FitsFile::open(folder / "snapshot.fits");
  const auto pixels = [&](const char* name, std::size_t count) {
    file.select(name);
    std::vector<float> values(count);
    file.read_pixels<float>(0, values);
    return values;
  };
  const std::vector<float> slopes = pixels("SLOPES", 2 * slot.slopes.x.size());
  for (std::size_t k = 0; k < slot.slopes.x.size(); ++k) {
    if (slot.slopes.valid[k] != 0) {
      EXPECT_EQ(slopes[k], slot.slopes.x[k]);
    }
  }
  const std::vector<float> adu = pixels("FRAME", frame.format().pixels());
  for (std::size_t k = 0; k < adu.size(); ++k)
    EXPECT_EQ(adu[k], static_cast<float>(frame.view().data<std::uint16_t>()[k]));
  EXPECT_TRUE(file.try_select("ZERNIKE"));
}

TEST_F(FrameSnapshotTest, AFrameOfAnotherPlanIsNotTaken) {
  const auto plan = this->plan();
  const auto other = this->plan();
  FrameBuffer frame(simulator_.format());
  const auto measured_slot = measured(*other, frame);
  const FrameSlot& slot = *measured_slot;
  FrameSnapshot snapshot(plan, simulator_.format());
  SnapshotExchange exchange;
  std::atomic<bool> over{false};
  std::thread publishes([&] {
    while (!over) exchange.offer(slot);
  });
  EXPECT_FALSE(exchange.wait(snapshot, 20ms));
  over = true;
  publishes.join();
}

TEST_F(FrameSnapshotTest, CopyingAllocatesNothing) {
  const auto plan = this->plan();
  FrameBuffer frame(simulator_.format());
  const auto measured_slot = measured(*plan, frame);
  const FrameSlot& slot = *measured_slot;
  FrameSnapshot snapshot(plan, simulator_.format());
  EXPECT_EQ(allocations_of_this_thread([&] { snapshot.copy(slot); }), 0);
}

}  // namespace
}  // namespace curlew
