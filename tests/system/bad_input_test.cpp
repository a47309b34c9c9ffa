// Bad input as a user meets it gives an exit code and one clear sentence, and leaves no
// half-written file.
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>

#include "tests/support/paths.h"
#include "tests/support/program.h"
#include "tests/support/raw_fits.h"
#include "tests/system/bench_optics.h"

namespace curlew {
namespace {

class BadInput : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    good_ = std::make_unique<ScratchDirectory>();
    const std::string small = "--rows 6 --cols 6 --photons 2000 --out ";
    ASSERT_EQ(run_curlew(*good_, "simulate --frames 5 " + small + "ref.fits").exit_code, 0);
    ASSERT_EQ(
        run_curlew(*good_, "simulate --frames 5 --window 10 " + small + "other.fits").exit_code, 0);
    const ProgramRun calibrated = run_curlew(*good_, "calibrate ref.fits --out sensor.fits");
    ASSERT_EQ(calibrated.exit_code, 0) << calibrated.err;
  }
  static void TearDownTestSuite() { good_.reset(); }

  void SetUp() override {
    for (const char* name : {"ref.fits", "other.fits", "sensor.fits"})
      std::filesystem::copy_file(*good_ / name, scratch_ / name);
  }

  /// Expects that the run fails with this code and one line on stderr that has all these words, and
  /// that no file comes or goes.
  void expect_refused(const std::string& arguments, int exit_code,
                      const std::vector<std::string>& words, const std::string& prefix = "") {
    const auto before = scratch_.names();
    const ProgramRun run = run_curlew(scratch_, arguments, prefix);
    SCOPED_TRACE(arguments + "\nstderr: " + run.err);
    EXPECT_EQ(run.exit_code, exit_code);
    EXPECT_EQ(std::count(run.err.begin(), run.err.end(), '\n'), 1) << "there must be one line";
    EXPECT_EQ(run.err.rfind("curlew: ", 0), 0U);
    for (const std::string& word : words)
      EXPECT_NE(run.err.find(word), std::string::npos) << "should say: " << word;
    EXPECT_EQ(scratch_.names(), before) << "no file may be left half-written";
  }

  void expect_all_refuse(const std::string& file, const std::vector<std::string>& words) {
    expect_refused("calibrate " + file + kOptics + "--out new.fits", 1, words);
    expect_refused("replay " + file + " --sensor sensor.fits --out new.fits --jsonl new.jsonl", 1,
                   words);
    expect_refused("replay ref.fits --sensor " + file + " --out new.fits", 1, {file});
    expect_refused("calibrate ref.fits --dark " + file + " --out new.fits", 1, words);
  }

  static std::unique_ptr<ScratchDirectory> good_;
  ScratchDirectory scratch_;
};
std::unique_ptr<ScratchDirectory> BadInput::good_;

TEST_F(BadInput, Missing) { expect_all_refuse("nowhere.fits", {"nowhere.fits"}); }

TEST_F(BadInput, Empty) {
  write_bytes(scratch_ / "empty.fits", "");
  expect_all_refuse("empty.fits", {"empty.fits", "empty"});
}

TEST_F(BadInput, NotFits) {
  write_bytes(scratch_ / "text.fits", std::string(10000, 'x'));
  expect_all_refuse("text.fits", {"text.fits", "FITS"});
}

TEST_F(BadInput, Truncated) {
  const std::string bytes = read_bytes(scratch_ / "ref.fits");
  write_bytes(scratch_ / "half.fits", bytes.substr(0, 2880 + 2 * 48 * 48 * 2 + 100));
  expect_all_refuse("half.fits", {"half.fits"});
}

TEST_F(BadInput, ZeroFrames) {
  write_bytes(scratch_ / "none.fits", raw_image_header(16, {"48", "48", "0"}));
  expect_all_refuse("none.fits", {"none.fits"});
}

TEST_F(BadInput, AllNan) {
  // A float of which every byte is 0xff is a NaN.
  std::string file = raw_image_header(-32, {"48", "48"});
  file += std::string((48 * 48 * 4 + 2879) / 2880 * 2880, '\xff');
  write_bytes(scratch_ / "nan.fits", file);
  expect_all_refuse("nan.fits", {"nan.fits"});
}

TEST_F(BadInput, DimensionsBeyondReason) {
  write_bytes(scratch_ / "overflow.fits",
              raw_image_header(16, {"4000000000", "4000000000", "4000000000"}));
  expect_all_refuse("overflow.fits", {"overflow.fits"});
  write_bytes(scratch_ / "memory.fits", raw_image_header(8, {"1000000", "1000000", "2"}));
  expect_all_refuse("memory.fits", {"memory.fits"});
}

TEST_F(BadInput, ARecordingThatDoesNotFitTheSensor) {
  expect_refused("replay other.fits --sensor sensor.fits --out new.fits", 1, {"48", "60"});
}

TEST_F(BadInput, ADirectory) {
  std::filesystem::create_directory(scratch_ / "folder");
  expect_refused("replay folder --sensor sensor.fits", 1, {"folder"});
}

TEST_F(BadInput, Configuration) {
  write_bytes(scratch_ / "c.toml", "[detect]\nfalse_alarm = 1\n");
  expect_refused("replay ref.fits --sensor sensor.fits --config c.toml", 2,
                 {"c.toml:2", "false_alarm"});
  expect_refused("replay ref.fits --sensor sensor.fits --config none.toml", 2, {"none.toml"});
  expect_refused("replay ref.fits --sensor sensor.fits --false-alarms -1", 2, {"false"});
  expect_refused("replay ref.fits --sensor sensor.fits --false-alarms nan", 2, {"false"});
  expect_refused("replay ref.fits --sensor sensor.fits --threads many", 2, {"--threads", "many"});
  expect_refused("replay ref.fits --sensor sensor.fits --pace -5", 2, {"--pace"});
  expect_refused("replay ref.fits --sensor sensor.fits --save slope --out new.fits", 2, {"slope"});
  expect_refused("replay ref.fits --sensor sensor.fits --save slopes", 2, {"--out"});
  expect_refused("replay ref.fits --sensor sensor.fits --out a --jsonl a", 2, {"same file a"});
}

TEST_F(BadInput, Usage) {
  expect_refused("replay ref.fits", 2, {"--sensor"});
  expect_refused("replay ref.fits --sensor sensor.fits --nonsense", 2, {"--nonsense"});
  expect_refused("bench latency --rows 0 --cols 8 --window 8", 2, {"--rows"});
  expect_refused("bench latency --rows 8", 2, {"--window"});
  expect_refused("bench centroid --rows 8 --cols 8", 2, {"--window"});
  expect_refused("bench split --rows 8", 2, {"--cols"});
  expect_refused("bench split --rounds 0", 2, {"--rounds"});
  expect_refused("bench circulation --vortices -1", 2, {"--vortices"});
  expect_refused("dance", 2, {"dance"});
  expect_refused("", 2, {"subcommand"});
  expect_refused("simulate --preset donut --out new.fits", 2, {"donut", "vortex"});
  expect_refused("simulate --preset vortex --vortex 1,2 --out new.fits", 2, {"--vortex", "1,2"});
  expect_refused("simulate --rows 0 --out new.fits", 2, {"lenslet row"});
  expect_refused("simulate --frames 0 --out new.fits", 2, {"--frames"});
  expect_refused("simulate --rows 6 --cols 6 --preset field --field ref.fits --out new.fits", 1,
                 {"ref.fits"});
}

TEST_F(BadInput, InputsAreNotWrittenOver) {
  expect_refused("replay ref.fits --sensor sensor.fits --out ref.fits", 2, {"ref.fits"});
  expect_refused("replay ref.fits --sensor sensor.fits --jsonl sensor.fits", 2, {"sensor.fits"});
  expect_refused("calibrate ref.fits --out ref.fits", 2, {"ref.fits"});
  expect_refused("calibrate ref.fits --out ./ref.fits", 2, {"ref.fits"});
  expect_refused("simulate --preset field --field ref.fits --out ref.fits", 2, {"ref.fits"});
  write_bytes(scratch_ / "c.toml", "");
  expect_refused("replay ref.fits --sensor sensor.fits --config c.toml --jsonl c.toml", 2,
                 {"c.toml"});
  expect_refused("calibrate ref.fits --config c.toml --out c.toml", 2, {"c.toml"});
  expect_refused("replay ref.fits --sensor sensor.fits --out a --jsonl ./a", 2, {"same file"});
  // An input that has the name of an unfinished output is an input like any other.
  std::filesystem::rename(scratch_ / "ref.fits", scratch_ / "new.fits.partial");
  const std::string before = read_bytes(scratch_ / "new.fits.partial");
  EXPECT_EQ(
      run_curlew(scratch_, "replay new.fits.partial --sensor sensor.fits --out new.fits").exit_code,
      0);
  EXPECT_EQ(read_bytes(scratch_ / "new.fits.partial"), before);
}

TEST_F(BadInput, LinksAreFollowedAndNotReplaced) {
  std::filesystem::create_directory(scratch_ / "folder");
  for (const char* name : {"new.fits", "new.jsonl"}) {
    write_bytes(scratch_ / (std::string("folder/") + name), "old");
    std::filesystem::create_symlink(scratch_ / (std::string("folder/") + name), scratch_ / name);
  }
  const ProgramRun run =
      run_curlew(scratch_,
                 "replay ref.fits --sensor sensor.fits --force --out new.fits --jsonl "
                 "new.jsonl");
  EXPECT_EQ(run.exit_code, 0) << run.err;
  for (const char* name : {"new.fits", "new.jsonl"}) {
    EXPECT_TRUE(std::filesystem::is_symlink(scratch_ / name));
    EXPECT_GT(std::filesystem::file_size(scratch_ / (std::string("folder/") + name)), 100U);
  }
  const ProgramRun piped =
      run_curlew(scratch_, "replay ref.fits --sensor sensor.fits --jsonl /dev/stdout");
  EXPECT_EQ(piped.exit_code, 0) << piped.err;
  EXPECT_NE(piped.out.find("{\"frame\":4,"), std::string::npos);
}

TEST_F(BadInput, WhatExistsIsReplacedOnlyByForce) {
  const std::string old = read_bytes(scratch_ / "other.fits");
  for (const char* command :
       {"simulate --out other.fits", "simulate --out new.fits --field-out other.fits",
        "calibrate ref.fits --out other.fits",
        "replay ref.fits --sensor sensor.fits --out other.fits",
        "replay ref.fits --sensor sensor.fits --jsonl other.fits",
        "calibrate --camera sim:plane --out new.fits --keep other.fits"})
    expect_refused(command, 2, {"other.fits exists already", "--force"});
  EXPECT_EQ(read_bytes(scratch_ / "other.fits"), old);
  EXPECT_EQ(run_curlew(scratch_, "calibrate ref.fits --out other.fits --force").exit_code, 0);
  EXPECT_NE(read_bytes(scratch_ / "other.fits"), old);
}

TEST_F(BadInput, OnlyRegularFilesAreEverReplaced) {
  namespace fs = std::filesystem;
  ASSERT_EQ(mkfifo((scratch_ / "pipe").c_str(), 0600), 0);
  fs::create_symlink("nowhere.fits", scratch_ / "dangling");
  fs::create_symlink("/dev/null", scratch_ / "device");
  for (const std::string output : {"pipe", "dangling", "device", "/dev/null", "."}) {
    const std::string force = " --force --out " + output;
    expect_refused("simulate --rows 6 --cols 6" + force, 1, {output, "cannot be written"});
    expect_refused("calibrate ref.fits" + force, 1, {output, "cannot be written"});
    expect_refused("calibrate --take-dark --camera sim:plane" + force, 1, {output});
    expect_refused("replay ref.fits --sensor sensor.fits" + force, 1, {output});
    expect_refused("simulate --rows 6 --cols 6 --out new.fits --force --field-out " + output, 1,
                   {output});
  }
  expect_refused("replay ref.fits --sensor sensor.fits --jsonl dangling", 1, {"dangling"});
  EXPECT_TRUE(fs::is_fifo(scratch_ / "pipe"));
  EXPECT_TRUE(fs::is_symlink(scratch_ / "dangling"));
  EXPECT_TRUE(fs::is_symlink(scratch_ / "device"));
  EXPECT_TRUE(fs::is_character_file("/dev/null"));
}

TEST_F(BadInput, WithoutStandardDescriptorsNothingStrayIsWritten) {
  for (const std::string closed : {"<&-", ">&-", "2>&-", "<&- >&- 2>&-"}) {
    const std::string line = "cd '" + scratch_.path() + "' && '" + kCurlewProgram +
                             "' replay ref.fits --sensor sensor.fits --force --out new.fits "
                             "--jsonl new.jsonl " +
                             closed + (closed.find('>') == std::string::npos ? " >/dev/null" : "");
    ASSERT_EQ(WEXITSTATUS(std::system(line.c_str())), 0) << closed;
    EXPECT_EQ(read_bytes(scratch_ / "new.jsonl").rfind("{\"frame\":0,", 0), 0U) << closed;
    EXPECT_EQ(read_bytes(scratch_ / "new.fits").rfind("SIMPLE", 0), 0U) << closed;
    const std::string lines = read_bytes(scratch_ / "new.jsonl");
    EXPECT_EQ(std::count(lines.begin(), lines.end(), '\n'), 5) << closed;
  }
}

// Aravis crashes where it is refused a socket.
TEST_F(BadInput, WithFewDescriptorsAravisIsNotAsked) {
  for (const int most : {16, 24, 40})
    expect_refused("calibrate --camera aravis: --out new.fits", 1, {"ulimit -n"},
                   "ulimit -n " + std::to_string(most) + "; ");
}

TEST_F(BadInput, StandardOutputTakesOnlyTheLines) {
  const ProgramRun run = run_curlew(scratch_, "replay ref.fits --sensor sensor.fits --jsonl -");
  EXPECT_EQ(run.exit_code, 0) << run.err;
  EXPECT_EQ(std::count(run.out.begin(), run.out.end(), '\n'), 5) << run.out;
  EXPECT_EQ(run.out.rfind("{\"frame\":0,", 0), 0U);
  EXPECT_NE(run.err.find("5 frames"), std::string::npos) << "the report goes to standard error";
  EXPECT_FALSE(std::filesystem::exists(scratch_ / "-"));
}

TEST_F(BadInput, OutputThatNobodyTakes) {
  const std::string line = "cd '" + scratch_.path() + "' && '" + kCurlewProgram +
                           "' replay ref.fits --sensor sensor.fits >/dev/full 2>err";
  EXPECT_EQ(WEXITSTATUS(std::system(line.c_str())), 1);
  EXPECT_NE(read_bytes(scratch_ / "err").find("standard output"), std::string::npos);
}

TEST_F(BadInput, NonsenseInHeaders) {
  // One digit of a card is changed, so that 1 electron an ADU becomes 0.
  std::string bytes = read_bytes(scratch_ / "sensor.fits");
  const std::size_t card = bytes.find("EPERADU =");
  ASSERT_NE(card, std::string::npos);
  bytes[bytes.find("1.", card)] = '0';
  write_bytes(scratch_ / "wrong.fits", bytes);
  expect_refused("replay ref.fits --sensor wrong.fits --out new.fits", 1,
                 {"wrong.fits", "EPERADU"});
}

TEST_F(BadInput, NoLightAndAllSaturated) {
  ASSERT_EQ(
      run_curlew(scratch_, "simulate --rows 6 --cols 6 --photons 0.001 --out dark.fits").exit_code,
      0);
  expect_refused("calibrate dark.fits --out new.fits", 1, {"dark.fits"});
  std::string file = raw_image_header(8, {"48", "48"});
  file += std::string((48 * 48 + 2879) / 2880 * 2880, '\xff');
  write_bytes(scratch_ / "bright.fits", file);
  expect_refused("calibrate bright.fits" + std::string(kOptics) + "--out new.fits", 1,
                 {"bright.fits"});
}

TEST_F(BadInput, OpticsUnknown) {
  std::string file = raw_image_header(8, {"48", "48"});
  file += std::string((48 * 48 + 2879) / 2880 * 2880, '\1');
  write_bytes(scratch_ / "plain.fits", file);
  expect_refused("calibrate plain.fits --out new.fits", 2, {"--pitch-um"});
  expect_refused("calibrate ref.fits --focal-mm -3 --out new.fits", 2, {"--focal-mm"});
}

TEST_F(BadInput, AFolderThatIsNotThere) {
  expect_refused("simulate --out none/new.fits", 1, {"none/new.fits"});
  expect_refused("calibrate ref.fits --out none/new.fits", 1, {"none/new.fits"});
  expect_refused("replay ref.fits --sensor sensor.fits --out none/new.fits", 1, {"none/new.fits"});
  expect_refused("replay ref.fits --sensor sensor.fits --jsonl none/new.jsonl", 1,
                 {"none/new.jsonl"});
}

TEST_F(BadInput, FullDisk) {
  // A limit on the file's size stands in for a full disk, for the write fails in the same place.
  // The limit of 16 KiB is reached in the middle of the frames, the images or the lines.
  const std::string limit = "ulimit -f 16; trap '' XFSZ; ";
  expect_refused("simulate --rows 6 --cols 6 --frames 50 --out new.fits", 1, {"new.fits", "full"},
                 limit);
  expect_refused("calibrate ref.fits --out new.fits", 1, {"new.fits", "full"}, limit);
  expect_refused("replay ref.fits --sensor sensor.fits --out new.fits --save slopes,phase", 1,
                 {"new.fits", "full"}, limit);
  expect_refused("convert ref.fits --out new.fits", 1, {"new.fits", "full"}, limit);
  const std::string little = "ulimit -f 1; trap '' XFSZ; ";
  expect_refused("replay ref.fits --sensor sensor.fits --jsonl new.jsonl", 1, {"new.jsonl", "full"},
                 little);
}

TEST_F(BadInput, FullDiskForReal) {
  const std::string mounted = scratch_ / "small";
  std::filesystem::create_directory(mounted);
  if (std::system(("mount -t tmpfs -o size=200k none '" + mounted + "' 2>/dev/null").c_str()) != 0)
    GTEST_SKIP() << "this user may not mount a small tmpfs";
  const ProgramRun run = run_curlew(scratch_, "simulate --frames 100 --out small/new.fits");
  const bool empty = std::filesystem::is_empty(mounted);
  EXPECT_EQ(std::system(("umount '" + mounted + "'").c_str()), 0);
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_NE(run.err.find("small/new.fits"), std::string::npos) << run.err;
  EXPECT_NE(run.err.find("full"), std::string::npos) << run.err;
  EXPECT_TRUE(empty) << "no file may be left half-written";
}

}  // namespace
}  // namespace curlew
