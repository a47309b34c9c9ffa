// The daemon keeps a simulated camera's spots bright and unsaturated.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include "tests/support/program.h"
#include "tests/support/scratch_directory.h"
#include "tests/system/daemon_fixture.h"

namespace curlew {
namespace {

/// The tests with a GigE Vision camera, whose ExposureTime is a register of GenICam.
using AutoExposureOverGige = Daemon;

struct Watched {
  std::vector<nlohmann::json> lines;
  std::int64_t changes = 0;
  std::string err;
};

std::int64_t count_of(const std::string& text, const std::string& what) {
  std::int64_t n = 0;
  for (std::size_t at = text.find(what); at != std::string::npos; at = text.find(what, at + 1)) ++n;
  return n;
}

/// Runs the daemon for some seconds on a simulated camera with this exposure; 1000 us is right. A
/// sanitized one may take six of them to draw the camera's frames.
Watched watch(const std::string& exposure_us, const std::string& more = "") {
  const ScratchDirectory scratch;
  write_bytes(scratch / "c.toml",
              "[camera]\nsource = \"sim:plane\"\nframe_rate_hz = 100\nauto_exposure = true\n"
              "exposure_us = " +
                  exposure_us + "\n" + more);
  const ProgramRun run = run_curlew(scratch, "run --config c.toml --jsonl lines.jsonl --seconds " +
                                                 std::string(kSanitized ? "14" : "5"));
  EXPECT_EQ(run.exit_code, 0) << run.err;
  Watched watched{.lines = json_lines(scratch / "lines.jsonl"), .err = run.err};
  watched.changes = count_of(run.err, "us instead of");
  return watched;
}

/// Returns how many lenslets were measured in the frames that came later than this after the first.
std::vector<std::int64_t> measured_after(const Watched& watched, double seconds) {
  std::vector<std::int64_t> valid;
  const auto first_ns = watched.lines.front()["received_ns"].get<std::int64_t>();
  for (const nlohmann::json& line : watched.lines)
    if (static_cast<double>(line["received_ns"].get<std::int64_t>() - first_ns) > seconds * 1e9)
      valid.push_back(line["n_valid"].get<std::int64_t>());
  return valid;
}

TEST(AutoExposure, SettlesWithinTwoSecondsFromAHundredTimesTooMuchAndTooLittle) {
  const double settled_s = kSanitized ? 3.5 : 2.0;
  for (const std::string exposure_us : {"100000", "10"}) {
    const Watched watched = watch(exposure_us);
    ASSERT_FALSE(watched.lines.empty()) << watched.err;
    EXPECT_EQ(watched.lines.front()["n_valid"], 0) << exposure_us << ": it must begin wrong";
    const std::vector<std::int64_t> valid = measured_after(watched, settled_s);
    ASSERT_FALSE(valid.empty());
    EXPECT_EQ(std::count(valid.begin(), valid.end(), 256), std::ssize(valid)) << watched.err;
    EXPECT_GE(watched.changes, 2) << watched.err;
    EXPECT_LE(watched.changes, 6) << watched.err;
  }
}

TEST_F(AutoExposureOverGige, SetsTheExposureTimeOfAGenicamCamera) {
  const std::string size = "--rows 12 --cols 12 --window 8 --bits 14 --photons 20000 ";
  run("simulate --preset plane " + size + "--frames 20 --out ref.fits");
  run("calibrate ref.fits --out sensor.fits");
  const auto server = serve({"--rate", "100", "--exposure-us", "10000"}, "ref.fits");
  for (const std::string exposure_us : {"100", "90000"}) {
    write_bytes(scratch_ / "c.toml",
                "[camera]\nsource = \"aravis:Aravis-Fake-CURLEW\"\nauto_exposure = true\n"
                "exposure_us = " +
                    exposure_us + "\n[daemon]\nsensor = \"" + (scratch_ / "sensor.fits") + "\"\n");
    std::filesystem::remove(scratch_ / "lines.jsonl");
    const ProgramRun ran =
        run_curlew(scratch_, "run --config c.toml --jsonl lines.jsonl --seconds " +
                                 std::string(kSanitized ? "6" : "3"));
    ASSERT_EQ(ran.exit_code, 0) << ran.err;
    const std::vector<nlohmann::json> lines = json_lines(scratch_ / "lines.jsonl");
    ASSERT_FALSE(lines.empty()) << ran.err;
    EXPECT_NE(ran.err.find(" us instead of " + exposure_us), std::string::npos) << ran.err;
    EXPECT_EQ(lines.back()["n_valid"], 144) << ran.err;
    EXPECT_GE(count_of(ran.err, "us instead of"), 1) << ran.err;
    EXPECT_LE(count_of(ran.err, "us instead of"), 6) << ran.err;
  }
}

TEST(AutoExposure, RestsWhileFramesAreRecorded) {
  const ScratchDirectory scratch;
  const Watched watched =
      watch("4000", "[recorder]\nmode = \"continuous\"\nfolder = \"" + scratch.path() + "\"\n");
  EXPECT_EQ(watched.changes, 0) << watched.err;
  EXPECT_NE(watched.err.find("auto_exposure rests while frames are recorded"), std::string::npos)
      << watched.err;
}

TEST(AutoExposure, SaysWhereACameraHasNoExposure) {
  const ScratchDirectory scratch;
  const ProgramRun made =
      run_curlew(scratch, "simulate --preset plane --frames 5 --out plane.fits --rows 8 --cols 8");
  ASSERT_EQ(made.exit_code, 0) << made.err;
  ASSERT_EQ(run_curlew(scratch, "calibrate plane.fits --out sensor.fits").exit_code, 0);
  write_bytes(scratch / "c.toml",
              "[camera]\nsource = \"file:plane.fits\"\nframe_rate_hz = 5\nauto_exposure = true\n"
              "[daemon]\nsensor = \"sensor.fits\"\n");
  const ProgramRun run = run_curlew(scratch, "run --config c.toml");
  EXPECT_NE(run.err.find("does not tell its exposure time"), std::string::npos) << run.err;
}

}  // namespace
}  // namespace curlew
