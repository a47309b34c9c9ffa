// The program from end to end: what it writes, compared with the truth, with itself and with other
// readers.
#include <gtest/gtest.h>

#include <cstring>
#include <filesystem>
#include <regex>

#include "acquisition/fits/fits_file.h"
#include "tests/support/paths.h"
#include "tests/support/program.h"

namespace curlew {
namespace {

/// These return all values of an image, or of a table column, as numbers.
std::vector<double> image_values(const std::string& path, const std::string& name) {
  FitsFile file = FitsFile::open(path);
  file.select(name);
  std::vector<double> values(static_cast<std::size_t>(file.image().elements()));
  file.read_pixels<double>(0, values);
  return values;
}
std::vector<double> column_values(const std::string& path, const std::string& table,
                                  const std::string& column) {
  FitsFile file = FitsFile::open(path);
  file.select(table);
  std::vector<double> values(static_cast<std::size_t>(file.row_count()));
  if (!values.empty()) file.read_column<double>(column, 0, values);
  return values;
}

bool same_bits(const std::vector<double>& a, const std::vector<double>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(double)) == 0;
}

class EndToEnd : public ::testing::Test {
 protected:
  void run(const std::string& arguments) {
    last_ = run_curlew(scratch_, arguments);
    ASSERT_EQ(last_.exit_code, 0) << arguments << "\n" << last_.err;
    EXPECT_EQ(last_.err, "") << "the program must not complain";
  }

  const std::string sensor_ = "--rows 12 --cols 12 --window 8 --pupil obscured ";
  void make_sensor() {
    run("simulate --preset plane " + sensor_ +
        "--frames 20 --photons 20000 --bits 14 --out ref.fits");
    run("calibrate ref.fits --out sensor.fits");
  }

  ScratchDirectory scratch_;
  ProgramRun last_;
};

TEST_F(EndToEnd, ThousandFramesInlineAndPerStageAreTheSameBytes) {
  make_sensor();
  run("simulate --preset vortex " + sensor_ +
      "--amplitude linear --core-radius 1.5 --vortex 3.4,2.6,+1 --vortex 8.7,8.2,-1 --photons 3000 "
      "--seed 7401 --frames 1000 --out beam.fits");
  const std::string replay =
      "replay beam.fits --sensor sensor.fits --save slopes,flux,phase,solenoidal,circulation "
      "--out ";
  run(replay + "inline.fits --threads inline");
  run(replay + "threads.fits --threads team");
  for (const char* image : {"SLOPES", "FLUX", "PHASE", "SOLENOIDAL", "CIRCULATION"}) {
    SCOPED_TRACE(image);
    const auto values = image_values(scratch_ / "inline.fits", image);
    EXPECT_GE(values.size(), 1000U * 121U);
    EXPECT_TRUE(same_bits(values, image_values(scratch_ / "threads.fits", image)));
  }
  EXPECT_GT(column_values(scratch_ / "inline.fits", "VORTICES", "X").size(), 1000U);
  for (const char* column : {"FRAME", "X", "Y", "CHARGE", "CIRCULATION", "SIGNIFICANCE", "X_PX",
                             "Y_PX", "FLAGS", "TRACK"})
    EXPECT_TRUE(same_bits(column_values(scratch_ / "inline.fits", "VORTICES", column),
                          column_values(scratch_ / "threads.fits", "VORTICES", column)))
        << column;
  for (const char* column : {"FRAME", "HOLE", "CIRCULATION"})
    EXPECT_TRUE(same_bits(column_values(scratch_ / "inline.fits", "HOLES", column),
                          column_values(scratch_ / "threads.fits", "HOLES", column)))
        << column;
}

TEST_F(EndToEnd, BrightVorticesAreAllFoundAndNothingElse) {
  make_sensor();
  run("simulate --preset vortex " + sensor_ +
      "--amplitude linear --core-radius 1.5 --vortex 3.4,2.6,+1 --vortex 8.7,8.2,-1 "
      "--zernike 6:0.5 --photons 5000 --frames 100 --seed 7402 --out beam.fits");
  run("replay beam.fits --sensor sensor.fits --show 1 --false-alarms 1e-5");
  EXPECT_NE(last_.out.find("against the truth: 200 of 200 found within 0.75 pitch, 0 false"),
            std::string::npos)
      << last_.out;
  EXPECT_NE(last_.out.find("p99.9"), std::string::npos);
}

// Behind turbulence pairs are created closer than a pitch. They count neither as found nor as
// false.
TEST_F(EndToEnd, EveryVortexFoundIsInOneColumnOfTheSummary) {
  run("simulate --preset plane --photons 2000 --frames 20 --seed 7405 --out ref.fits");
  run("calibrate ref.fits --out sensor.fits");
  run("simulate --preset turbulence --rytov-variance 2 --photons 1000 --frames 10 --seed 7406 "
      "--out beam.fits");
  run("replay beam.fits --sensor sensor.fits --method classifier --show 10");
  const auto number = [&](const std::string& pattern) {
    std::smatch found;
    EXPECT_TRUE(std::regex_search(last_.out, found, std::regex(pattern))) << last_.out;
    return found.size() > 1 ? std::stoi(found[1]) : -1;
  };
  const int hits = number("truth: (\\d+) of");
  const int required = number("of (\\d+) found within");
  EXPECT_GT(number("not counted: (\\d+) true"), 0);
  EXPECT_EQ(hits + number("pitch, (\\d+) false") + number("(\\d+) that hit one of those") +
                number("and (\\d+) unresolved pairs"),
            number("frames, (\\d+) vortices"));
  const std::regex missed("missed");
  EXPECT_EQ(std::distance(std::sregex_iterator(last_.out.begin(), last_.out.end(), missed),
                          std::sregex_iterator()),
            required - hits)
      << "only required vortices may be shown as missed";
}

TEST_F(EndToEnd, MirroringFlipsCharges) {
  make_sensor();
  run("calibrate ref.fits --mirror --out mirrored.fits");
  run("simulate --preset vortex " + sensor_ +
      "--amplitude linear --core-radius 1.5 --vortex 3.4,2.6,+1 --photons 5000 --out beam.fits");
  run("replay beam.fits --sensor sensor.fits --out a.fits --false-alarms 1e-5");
  run("replay beam.fits --sensor mirrored.fits --out b.fits --false-alarms 1e-5");
  ASSERT_EQ(column_values(scratch_ / "a.fits", "VORTICES", "CHARGE"), std::vector<double>{1.0});
  ASSERT_EQ(column_values(scratch_ / "b.fits", "VORTICES", "CHARGE"), std::vector<double>{-1.0});
  for (const char* column : {"X_PX", "Y_PX"})  // it must be the same place on the detector
    EXPECT_NEAR(column_values(scratch_ / "a.fits", "VORTICES", column)[0],
                column_values(scratch_ / "b.fits", "VORTICES", column)[0], 0.01);
}

TEST_F(EndToEnd, FramesCountOnOverAllRecordings) {
  make_sensor();
  const std::string beam = "simulate --preset vortex " + sensor_ +
                           "--amplitude linear --core-radius 1.5 --photons 5000 --frames 3 ";
  run(beam + "--vortex 3.4,2.6,+1 --out one.fits");
  run(beam + "--vortex 8.7,8.2,-1 --out two.fits");
  run("replay one.fits two.fits --sensor sensor.fits --out all.fits --false-alarms 1e-5");
  EXPECT_NE(last_.out.find("against the truth: 6 of 6 found"), std::string::npos) << last_.out;
  EXPECT_NE(last_.out.find("0 frames dropped"), std::string::npos) << last_.out;
  EXPECT_EQ(column_values(scratch_ / "all.fits", "FRAMES", "FRAME"),
            (std::vector<double>{0, 1, 2, 3, 4, 5}));
  EXPECT_EQ(column_values(scratch_ / "all.fits", "VORTICES", "CHARGE"),
            (std::vector<double>{1, 1, 1, -1, -1, -1}));
}

TEST_F(EndToEnd, AstropyReadsEveryFileAndItsRecordingReplays) {
  make_sensor();
  run("simulate --preset vortex " + sensor_ +
      "--amplitude linear --core-radius 1.5 --vortex 3.4,2.6,+1 --photons 5000 --frames 5 --out "
      "beam.fits");
  run("replay beam.fits --sensor sensor.fits --false-alarms 1e-5 --out ours.fits --jsonl "
      "ours.jsonl --save "
      "slopes,flux,phase,solenoidal,circulation");
  const std::string script = std::string("/usr/bin/python3 '") + kSourceDir +
                             "/tests/support/read_as_a_stranger.py' '" + scratch_.path() + "' 2>&1";
  FILE* pipe = popen(script.c_str(), "r");
  ASSERT_NE(pipe, nullptr);
  std::string said;
  for (int c = 0; (c = fgetc(pipe)) != EOF;) said += static_cast<char>(c);
  const int status = pclose(pipe);
  if (WEXITSTATUS(status) == 77 || WEXITSTATUS(status) == 127)
    GTEST_SKIP() << "python3-astropy is not installed";
  ASSERT_EQ(status, 0) << said;

  // The script wrote the same pixels as a plain cube of its own.
  run("replay theirs.fits --sensor sensor.fits --false-alarms 1e-5 --out theirs_results.fits");
  for (const char* column : {"FRAME", "X", "Y", "CHARGE", "CIRCULATION"})
    EXPECT_EQ(column_values(scratch_ / "ours.fits", "VORTICES", column),
              column_values(scratch_ / "theirs_results.fits", "VORTICES", column));
}

TEST_F(EndToEnd, AnInterruptedReplayKeepsItsFrames) {
  make_sensor();
  run("simulate --preset plane " + sensor_ + "--photons 2000 --frames 400 --out long.fits");
  const ProgramRun replay =
      run_curlew(scratch_, "replay long.fits --sensor sensor.fits --pace 100 --out part.fits",
                 "timeout --preserve-status --foreground -s INT 1");
  EXPECT_EQ(replay.exit_code, 1);
  const auto frames = column_values(scratch_ / "part.fits", "FRAMES", "FRAME").size();
  EXPECT_NE(replay.err.find("interrupted: the files hold the first " + std::to_string(frames) +
                            " of 400 frames"),
            std::string::npos)
      << replay.out << replay.err;
  EXPECT_GT(frames, 0U);
  EXPECT_LT(frames, 400U);
  for (const std::string& name : scratch_.names())
    EXPECT_EQ(name.find("partial"), std::string::npos) << name;
}

TEST_F(EndToEnd, HelpAndVersion) {
  run("--help");
  for (const char* command : {"simulate", "calibrate", "replay", "bench"}) {
    EXPECT_NE(last_.out.find(command), std::string::npos);
    run(std::string(command) + " --help");
    EXPECT_GT(last_.out.size(), 100U);
    run("--help");
  }
  run("--version");
  EXPECT_EQ(last_.out.rfind("curlew ", 0), 0U);
}

TEST_F(EndToEnd, BenchLatencyAsJson) {
  const ProgramRun bench =
      run_curlew(scratch_, "bench latency --rows 8 --cols 8 --window 6 --frames 50 --json");
#ifdef NDEBUG
  ASSERT_EQ(bench.exit_code, 0) << bench.err;
  for (const char* word : {"\"p50\"", "\"p90\"", "\"p99\"", "\"p99.9\"", "\"max\"", "\"centroid\"",
                           "\"split\"", "\"total\"", "\"build\"", "\"cpu\"", "\"pinning\""})
    EXPECT_NE(bench.out.find(word), std::string::npos) << word;
#else
  EXPECT_EQ(bench.exit_code, 1);
  EXPECT_NE(bench.err.find("debug build"), std::string::npos);
#endif
}

}  // namespace
}  // namespace curlew
