// The picture for a terminal: where the light is, and which colours stand for what.
#include "service/watch/terminal_picture.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <sstream>

#include "acquisition/simulator/simulator.h"
#include "service/pipeline.h"
#include "tests/support/exact_sensor.h"

namespace curlew {
namespace {

constexpr int kWindow = 8;

/// Returns the copy of a frame with one vortex.
FrameCopy copy_of_a_frame() {
  SimulatorOptions options;
  options.rows = options.cols = 8;
  options.window_px = kWindow;
  options.photons = 5000.0;
  options.frames = 1;
  options.scene.core_radius = 1.5;
  options.scene.vortices = {{3.5, 3.5, 1}};
  options.scene.vortex_amplitude = VortexAmplitude::kLinearCore;
  Simulator simulator(options);
  Pipeline pipeline(std::make_shared<const Plan>(sensor_of(simulator, kWindow, 0.0),
                                                 simulator.format(), Config{}),
                    {});
  RecordedFeed feed(simulator, {});
  FrameCopy copy;
  Publisher publisher;
  publisher.finish = [&](const FrameSlot& slot, std::int64_t) {
    copy.copy(slot, 0);
    copy.fit();
    EXPECT_TRUE(copy.copy(slot, 0));
  };
  pipeline.run(feed, publisher);
  return copy;
}

int count(const std::string& text, const std::string& what) {
  int n = 0;
  for (std::size_t at = 0; (at = text.find(what, at)) != std::string::npos; at += what.size()) ++n;
  return n;
}

TEST(TerminalPicture, HasTwoRowsALineAndNoPaneWiderThanAsked) {
  const FrameCopy copy = copy_of_a_frame();
  const std::string text = terminal_picture(copy, 32);
  EXPECT_EQ(count(text, "\n"), 16 + 1) << "64 px in 32 columns are 32 rows, and the scales";
  EXPECT_EQ(count(text, "▀"), 16 * (32 + 8 + 7));
  EXPECT_EQ(count(terminal_picture(copy, 8), "▀"), 4 * (8 + 8 + 7));
  EXPECT_NE(text.find("frame 0  phase ±"), std::string::npos);
}

TEST(TerminalPicture, MarksTheVortexInItsColourOnce) {
  FrameCopy copy = copy_of_a_frame();
  ASSERT_EQ(copy.result.vortices.size(), 1U);
  const std::string red = "240;50;50";
  const std::string blue = "80;150;255";
  EXPECT_EQ(count(terminal_picture(copy, 32), red), 1);
  EXPECT_EQ(count(terminal_picture(copy, 32), blue), 0);
  copy.result.vortices[0].charge = -1;
  EXPECT_EQ(count(terminal_picture(copy, 32), blue), 1);
  // The cell (3, 3) is in the second line, below; the fourth of its pane.
  std::istringstream lines(terminal_picture(copy, 32));
  std::string line;
  for (int i = 0; i < 2; ++i) std::getline(lines, line);
  EXPECT_NE(line.find("48;2;" + blue), std::string::npos) << "the lower half";
}

}  // namespace
}  // namespace curlew
