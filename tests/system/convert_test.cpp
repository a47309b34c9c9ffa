// Recordings that were turned into those of others, and back, give the same results.
#include <gtest/gtest.h>

#include "acquisition/fits/fits_file.h"
#include "acquisition/recording/fits_source.h"
#include "tests/support/program.h"

namespace curlew {
namespace {

class Convert : public ::testing::Test {
 protected:
  void SetUp() override {
    const std::string size = "--rows 12 --cols 12 --window 8 ";
    run("simulate --preset plane " + size + "--frames 5 --photons 20000 --out ref.fits");
    run("calibrate ref.fits --out sensor.fits");
    run("simulate --preset dipole " + size + "--frames 8 --photons 3000 --out beam.fits");
  }
  ProgramRun run(const std::string& arguments, int exit_code = 0) {
    ProgramRun program = run_curlew(scratch_, arguments);
    EXPECT_EQ(program.exit_code, exit_code) << arguments << "\n" << program.err;
    return program;
  }
  /// Returns what replay finds, without what it says of times.
  std::string slopes_of(const std::string& inputs) {
    run("replay " + inputs + " --sensor sensor.fits --save slopes --out results.fits --force");
    FitsFile file = FitsFile::open(scratch_ / "results.fits");
    file.select("SLOPES");
    std::vector<float> slopes(static_cast<std::size_t>(file.image().elements()));
    file.read_pixels<float>(0, slopes);
    return {reinterpret_cast<const char*>(slopes.data()), slopes.size() * sizeof(float)};
  }
  ScratchDirectory scratch_;
};

TEST_F(Convert, MilkAndBack) {
  const std::string direct = slopes_of("beam.fits");
  run("convert beam.fits --milk telemetry --name wfs");
  run("convert telemetry --out back.fits");
  EXPECT_EQ(slopes_of("back.fits"), direct);
  FitsSource before({scratch_ / "beam.fits"});
  FitsSource after({scratch_ / "back.fits"});
  FrameBuffer a(before.format());
  FrameBuffer b(after.format());
  for (int i = 0; i < 8; ++i) {
    ASSERT_EQ(before.next(a), Delivery::kFrame);
    ASSERT_EQ(after.next(b), Delivery::kFrame);
    EXPECT_EQ(a.header.sequence, b.header.sequence);
    EXPECT_NEAR(static_cast<double>(a.header.camera_ns - b.header.camera_ns), 0.0, 500.0);
  }
}

TEST_F(Convert, RawPixels) {
  const std::string direct = slopes_of("beam.fits");
  FitsSource source({scratch_ / "beam.fits"});
  FrameBuffer frame(source.format());
  std::string bytes = "some header";
  while (source.next(frame) == Delivery::kFrame)
    bytes.append(reinterpret_cast<const char*>(frame.data()), frame.format().bytes());
  write_bytes(scratch_ / "beam.raw", bytes);
  run("convert beam.raw --raw 96x96 --raw-header 11 --out back.fits");
  EXPECT_EQ(slopes_of("back.fits"), direct);
}

TEST_F(Convert, MistakesAreSaid) {
  const auto says = [&](const std::string& arguments, int exit_code, const std::string& sentence) {
    EXPECT_NE(run("convert " + arguments, exit_code).err.find(sentence), std::string::npos)
        << arguments;
  };
  says("beam.fits", 2, "give --out REC.fits or --milk DIR");
  says("beam.fits --out a.fits --milk b", 2, "one of the two");
  says("beam.fits --out beam.fits", 2, "is an input of this run");
  says("beam.fits --milk d --name a/b", 2, "cannot be a stream's name");
  says("beam.fits --raw 96 --out a.fits", 2, "--raw must be ROWSxCOLS");
  says("beam.fits --raw 96x96 --raw-type f4 --out a.fits", 2, "--raw-type must be");
  says("beam.fits --raw 97x96 --out a.fits", 1, "whole frames");
  says("missing.fits --out a.fits", 1, "missing.fits");
}

}  // namespace
}  // namespace curlew
