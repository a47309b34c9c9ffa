// What the daemon says of a camera's frames is what replay says of the same frames, though windows
// and levels follow the frames before: through a loss of light, a reload and a new connection.
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>

#include "acquisition/recording/fits_source.h"
#include "acquisition/recording/recording.h"
#include "service/daemon/control_socket.h"
#include "tests/support/fake_gige_camera.h"
#include "tests/support/loopback.h"
#include "tests/support/paths.h"
#include "tests/support/process.h"
#include "tests/support/program.h"

namespace curlew {
namespace {

using nlohmann::json;
using std::chrono::seconds;

constexpr std::int64_t kImages = 80;
constexpr std::int64_t kDarkFrom = 30;
constexpr std::int64_t kDarkTo = 40;
constexpr std::ptrdiff_t kFramesAPixel = 8;
constexpr std::int64_t kFramesOfAPart = 150;
constexpr std::uint16_t kLevel = 100;  // ADU, the simulator's bias

class LiveReplay : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { claim_loopback(); }

  void run(const std::string& arguments) {
    const ProgramRun program = run_curlew(scratch_, arguments);
    ASSERT_EQ(program.exit_code, 0) << arguments << "\n" << program.err;
  }

  /// Makes the images that the camera shows: two vortices, spots that wander to the right by a
  /// pixel more every few frames, and frames without light.
  void make_images() {
    const std::string size = "--rows 12 --cols 12 --window 8 --bits 14 ";
    run("simulate --preset plane " + size + "--frames 20 --photons 20000 --out ref.fits");
    run("calibrate ref.fits --out sensor.fits");
    run("simulate --preset vortex " + size +
        "--amplitude linear --core-radius 1.5 --vortex 3.4,2.6,+1 --vortex 8.7,8.2,-1 "
        "--photons 1500 --seed 7701 --out still.fits --frames " +
        std::to_string(kImages));
    FitsSource still({scratch_ / "still.fits"});
    RecordingWriter writer(scratch_ / "beam.fits", still.format(), {}, {}, "test");
    FrameBuffer frame(still.format());
    const auto cols = static_cast<std::ptrdiff_t>(still.format().cols);
    for (std::int64_t i = 0; still.next(frame) == Delivery::kFrame; ++i) {
      const bool dark = i >= kDarkFrom && i < kDarkTo;
      const std::ptrdiff_t shift = dark ? cols : i / kFramesAPixel;
      auto* pixels = reinterpret_cast<std::uint16_t*>(frame.data());
      for (int row = 0; row < still.format().rows; ++row, pixels += cols) {
        std::move_backward(pixels, pixels + (cols - shift), pixels + cols);
        std::fill_n(pixels, shift, kLevel);
      }
      writer.append(frame.view(), frame.header);
    }
    writer.commit();
  }

  std::unique_ptr<Process> serve() {
    auto server = std::make_unique<Process>(
        std::vector<std::string>{kServeGige, scratch_ / "beam.fits", "--rate", "150"},
        scratch_ / "server.out", scratch_ / "server.err");
    EXPECT_TRUE(server->says("ready", seconds(20))) << server->err();
    return server;
  }

  std::int64_t status(const char* what) const {
    return json::parse(ask_daemon(scratch_ / "control", "status"))[what].get<std::int64_t>();
  }
  void wait_for_more_results(std::int64_t more) const {
    const std::int64_t wanted = status("results") + more;
    const auto until = std::chrono::steady_clock::now() + seconds(60);
    while (status("results") < wanted && std::chrono::steady_clock::now() < until)
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    ASSERT_GE(status("results"), wanted);
  }

  std::vector<json> lines_of(const std::string& name) const {
    std::vector<json> lines;
    std::ifstream file(scratch_ / name);
    for (std::string line; std::getline(file, line);) lines.push_back(json::parse(line));
    return lines;
  }

  /// Writes the frames of these results, in their order, as a recording.
  void record(const std::vector<json>& results) {
    FitsSource images({scratch_ / "beam.fits"});
    std::vector<std::vector<std::byte>> pixels;
    FrameBuffer frame(images.format());
    while (images.next(frame) == Delivery::kFrame)
      pixels.emplace_back(frame.data(), frame.data() + images.format().bytes());
    RecordingWriter writer(scratch_ / "seen.fits", images.format(), {}, {}, "test");
    for (const json& result : results) {
      FrameHeader header;
      header.sequence = result["sequence"];
      header.camera_ns = result["camera_ns"];
      header.received_ns = result["received_ns"];
      const auto& image = pixels[FakeGigeCamera::image_of(header.sequence, pixels.size())];
      std::copy(image.begin(), image.end(), frame.data());
      writer.append(frame.view(), header);
    }
    writer.commit();
  }

  ScratchDirectory scratch_;
};

TEST_F(LiveReplay, WhatFollowsTheFramesIsTheSameLiveAndInReplay) {
  make_images();
  if (HasFatalFailure()) return;
  write_bytes(scratch_ / "live.toml",
              "[camera]\ntimeout_s = 0.5\nmax_backoff_s = 0.2\n[daemon]\ncontrol = \"" +
                  (scratch_ / "control") + "\"\n");
  Process curlew(
      {kCurlewProgram, "run", "--config", scratch_ / "live.toml", "--camera", "aravis:127.0.0.1",
       "--sensor", scratch_ / "sensor.fits", "--jsonl", scratch_ / "live.jsonl"},
      scratch_ / "daemon.out", scratch_ / "daemon.err");
  ASSERT_TRUE(curlew.says("state=searching", seconds(20))) << curlew.err();
  auto server = serve();
  ASSERT_TRUE(curlew.says("state=streaming", seconds(20))) << curlew.err();
  wait_for_more_results(kFramesOfAPart);
  curlew.signal(SIGHUP);
  ASSERT_TRUE(curlew.says("are in use", seconds(20))) << curlew.err();
  wait_for_more_results(kFramesOfAPart);
  server->signal(SIGKILL);
  server->wait(seconds(5));
  const std::int64_t connections = status("connections");
  server = serve();
  wait_for_more_results(kFramesOfAPart);
  EXPECT_GT(status("connections"), connections);
  curlew.signal(SIGTERM);
  ASSERT_EQ(curlew.wait(seconds(30)), 0) << curlew.err();

  const std::vector<json> live = lines_of("live.jsonl");
  ASSERT_GE(static_cast<std::int64_t>(live.size()), 3 * kFramesOfAPart);
  record(live);
  run("replay seen.fits --sensor sensor.fits --jsonl replay.jsonl");
  const std::vector<json> replayed = lines_of("replay.jsonl");
  ASSERT_EQ(replayed.size(), live.size());
  int dark = 0;
  std::size_t vortices = 0;
  for (std::size_t i = 0; i < live.size(); ++i) {
    for (const char* what : {"n_valid", "n_lost", "n_islands", "vortices"})
      ASSERT_EQ(live[i][what].dump(), replayed[i][what].dump()) << what << " of frame " << i;
    dark += live[i]["n_valid"] == 0 ? 1 : 0;
    vortices += live[i]["vortices"].size();
  }
  EXPECT_GT(dark, 10) << "there must be frames without light";
  EXPECT_GT(vortices, 100U) << "there must be vortices to compare";
}

}  // namespace
}  // namespace curlew
