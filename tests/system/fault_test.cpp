// Each call that writes a file fails once, as on a full or broken disk. Nothing may be lost without
// being said, and no half file may stay.
#include <gtest/gtest.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <sstream>

#include "acquisition/fits/fits_file.h"
#include "tests/support/program.h"

namespace curlew {
namespace {

namespace fs = std::filesystem;

struct Fault {
  const char* call;
  int error;  ///< 0: a write takes half of the bytes
};

class FaultsOnPurpose : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    good_ = std::make_unique<ScratchDirectory>();
    const std::string small = "--rows 6 --cols 6 --photons 2000 --frames 5 --out ref.fits";
    ASSERT_EQ(run_curlew(*good_, "simulate " + small).exit_code, 0);
    ASSERT_EQ(
        run_curlew(*good_, "simulate --rows 6 --cols 6 --frames 40 --out long.fits").exit_code, 0);
    ASSERT_EQ(run_curlew(*good_, "calibrate ref.fits --out sensor.fits").exit_code, 0);
  }
  static void TearDownTestSuite() { good_.reset(); }

  /// Runs the program over and over, in a folder of its own each time, and lets more calls succeed
  /// each time before one fails, until none fails any more or the `most`-th has failed. before:
  /// shell text to run first.
  void for_each_call(const Fault& fault, int most, const std::string& before,
                     const std::string& arguments,
                     const std::function<void(const ScratchDirectory&, const ProgramRun&)>& check) {
    for (int at = 1; at <= most; at += 1 + at / 2) {
      SCOPED_TRACE(std::string(fault.call) + " " + std::to_string(at) + ", error " +
                   std::to_string(fault.error));
      const ScratchDirectory folder;
      const ScratchDirectory elsewhere;
      for (const char* name : {"ref.fits", "long.fits", "sensor.fits"})
        fs::copy_file(*good_ / name, folder / name);
      const std::string mark = elsewhere / "mark";
      const ProgramRun run = run_curlew(
          folder, arguments,
          before +
              "ASAN_OPTIONS=verify_asan_link_order=0 LD_PRELOAD=" CURLEW_FAILING_CALLS
              " CURLEW_FAIL_CALL=" +
              fault.call + " CURLEW_FAIL_AT=" + std::to_string(at) + " CURLEW_FAIL_PATH=made" +
              " CURLEW_FAIL_WITH=" + std::to_string(fault.error) + " CURLEW_FAIL_MARK=" + mark);
      check(folder, run);
      if (!fs::exists(mark)) return;
      ++faults_;
    }
  }

  static std::unique_ptr<ScratchDirectory> good_;
  int faults_ = 0;
};
std::unique_ptr<ScratchDirectory> FaultsOnPurpose::good_;

void expect_whole_or_absent(const ScratchDirectory& folder, const std::string& name) {
  if (!fs::exists(folder / name)) return;
  FitsFile file = FitsFile::open(folder / name);
  file.select("FRAMES");
  EXPECT_EQ(file.row_count(), 5) << name;
}

TEST_F(FaultsOnPurpose, FilesOfReplayAreWholeOrNotThereAndTheExitCodeTells) {
  for (const Fault& fault :
       {Fault{"open", ENOSPC}, Fault{"open", EMFILE}, Fault{"write", ENOSPC}, Fault{"write", EIO},
        Fault{"write", EINTR}, Fault{"write", 0}, Fault{"close", EIO}, Fault{"rename", EIO},
        Fault{"fopen", ENOSPC}, Fault{"fwrite", ENOSPC}, Fault{"fclose", EIO}}) {
    const bool harmless = fault.error == EINTR || fault.error == 0;
    const int before = faults_;
    for_each_call(
        fault, 20, "", "replay ref.fits --sensor sensor.fits --out made.fits --jsonl made.jsonl",
        [&](const ScratchDirectory& folder, const ProgramRun& run) {
          for (const std::string& name : folder.names())
            EXPECT_EQ(name.find("partial"), std::string::npos) << name;
          expect_whole_or_absent(folder, "made.fits");
          if (fs::exists(folder / "made.jsonl")) {
            const std::string lines = read_bytes(folder / "made.jsonl");
            EXPECT_EQ(std::count(lines.begin(), lines.end(), '\n'), 5);
          }
          const bool both = fs::exists(folder / "made.fits") && fs::exists(folder / "made.jsonl");
          EXPECT_EQ(run.exit_code, both ? 0 : 1) << run.err;
          EXPECT_TRUE(!harmless || run.exit_code == 0) << run.err;
          if (run.exit_code == 0) return;
          EXPECT_EQ(std::count(run.err.begin(), run.err.end(), '\n'), 1) << run.err;
          EXPECT_NE(run.err.find("made."), std::string::npos) << run.err;
        });
    EXPECT_GT(faults_, before) << fault.call << " was never called";
  }
}

/// Returns the number before the words in the report.
std::int64_t number_before(const std::string& report, const std::string& words) {
  const std::size_t end = report.find(words);
  if (end == std::string::npos) return 0;
  const std::size_t begin = report.find_last_of(" \n", end - 1) + 1;
  return std::stoll(report.substr(begin, end - begin));
}

TEST_F(FaultsOnPurpose, TheDaemonCountsWhatItCouldNotWrite) {
  for (const Fault& fault :
       {Fault{"write", ENOSPC}, Fault{"write", 0}, Fault{"pwrite", ENOSPC}, Fault{"pwrite", EINTR},
        Fault{"pwrite", 0}, Fault{"ftruncate", EIO}, Fault{"renameat2", EACCES}}) {
    const std::string prepare =
        "mkdir made; printf '[recorder]\\nmode = \"continuous\"\\nfolder = \"made\"\\nmin_free_mb "
        "= "
        "0\\n' >c.toml; ";
    for_each_call(
        fault, 2, prepare,
        "run --camera file:long.fits --sensor sensor.fits --config c.toml --jsonl made.jsonl",
        [&](const ScratchDirectory& folder, const ProgramRun& run) {
          EXPECT_EQ(run.exit_code, 0) << run.err;
          const std::int64_t results = number_before(run.out, " results + ");
          std::int64_t lines = 0;
          std::istringstream text(read_bytes(folder / "made.jsonl"));
          for (std::string line; std::getline(text, line); ++lines)
            EXPECT_TRUE(nlohmann::json::accept(line)) << line;
          EXPECT_EQ(lines + number_before(run.out, " results not written"), results);
          std::int64_t recorded = 0;
          for (const auto& entry : fs::directory_iterator(folder / "made")) {
            FitsFile file = FitsFile::open(entry.path().string());
            recorded += file.image().shape.empty() ? 0 : file.image().shape[0];
          }
          EXPECT_EQ(recorded, number_before(run.out, " frames in ")) << run.out;
          EXPECT_EQ(recorded + number_before(run.out, " frames dropped\n"), results)
              << run.out << run.err;
        });
  }
}

}  // namespace
}  // namespace curlew
