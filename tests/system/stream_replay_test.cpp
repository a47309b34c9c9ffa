// A recording that another program plays into a stream gives the results of its direct replay.
#include <gtest/gtest.h>

#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

#include "acquisition/isio/mapped_stream.h"
#include "acquisition/recording/fits_source.h"
#include "service/publish/stream_writer.h"
#include "tests/support/paths.h"
#include "tests/support/process.h"
#include "tests/support/program.h"

namespace curlew {
namespace {

using nlohmann::json;
using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr std::int64_t kReplayedFrames = 60;

std::vector<json> json_lines(const std::string& path) {
  std::vector<json> lines;
  std::ifstream file(path);
  for (std::string line; std::getline(file, line);) lines.push_back(json::parse(line));
  return lines;
}

class StreamReplay : public ::testing::Test {
 protected:
  StreamReplay() {
    const std::string size = "--rows 12 --cols 12 --window 8 ";
    run("simulate --preset plane " + size + "--frames 20 --photons 20000 --bits 14 --out ref.fits");
    run("calibrate ref.fits --out sensor.fits");
    run("simulate --preset vortex " + size +
        "--amplitude linear --core-radius 1.5 --vortex 3.4,2.6,+1 --vortex 8.7,8.2,-1 "
        "--photons 1500 --seed 7701 --out beam.fits --frames " +
        std::to_string(kReplayedFrames));
    run("replay beam.fits --sensor sensor.fits --jsonl replay.jsonl");
  }
  void run(const std::string& arguments) {
    const ProgramRun program = run_curlew(scratch_, arguments);
    ASSERT_EQ(program.exit_code, 0) << arguments << "\n" << program.err;
  }

  ScratchDirectory scratch_;
};

TEST_F(StreamReplay, ResultsAreThoseOfTheFile) {
  FitsSource source({scratch_ / "beam.fits"});
  const FrameFormat format = source.format();
  std::vector<std::unique_ptr<FrameBuffer>> frames;
  for (auto frame = std::make_unique<FrameBuffer>(format); source.next(*frame) == Delivery::kFrame;
       frame = std::make_unique<FrameBuffer>(format))
    frames.push_back(std::move(frame));
  ASSERT_EQ(frames.size(), static_cast<std::size_t>(kReplayedFrames));

  StreamWriter stream(scratch_.path(), {"rtc",
                                        StreamType::kU16,
                                        {static_cast<std::uint32_t>(format.cols),
                                         static_cast<std::uint32_t>(format.rows)},
                                        "adu",
                                        "",
                                        ""});
  const std::string file = scratch_ / "rtc.im.shm";
  Process curlew({kCurlewProgram, "run", "--camera", "isio:" + file, "--sensor",
                  scratch_ / "sensor.fits", "--jsonl", scratch_ / "live.jsonl", "--frames", "100"},
                 scratch_ / "out", scratch_ / "err");
  ASSERT_TRUE(curlew.says("streaming", seconds(20))) << curlew.err();
  // The stream's counter begins at 1, and its update n shows image (n − 1) modulo kReplayedFrames.
  for (std::int64_t update = 1; update < 5000 && curlew.running(); ++update) {
    const FrameBuffer& frame = *frames[static_cast<std::size_t>((update - 1) % kReplayedFrames)];
    std::memcpy(stream.begin(), frame.view().pixels, format.bytes());
    stream.end({update, update, frame.header.received_ns, 0}, 0);
    std::this_thread::sleep_for(milliseconds(4));
  }
  ASSERT_EQ(curlew.wait(seconds(20)), 0) << curlew.err();

  const std::vector<json> truth = json_lines(scratch_ / "replay.jsonl");
  const std::vector<json> lines = json_lines(scratch_ / "live.jsonl");
  ASSERT_EQ(lines.size(), 100U);
  std::size_t vortices = 0;
  for (const json& line : lines) {
    const auto image =
        static_cast<std::size_t>((line["sequence"].get<std::int64_t>() - 1) % kReplayedFrames);
    ASSERT_EQ(line["vortices"].dump(), truth[image]["vortices"].dump()) << line["sequence"];
    ASSERT_EQ(line["n_valid"], truth[image]["n_valid"]);
    vortices += line["vortices"].size();
  }
  EXPECT_GT(vortices, 100U) << "there must be vortices to compare";
}

}  // namespace
}  // namespace curlew
