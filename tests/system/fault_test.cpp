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
#include "tests/support/failing_calls.h"
#include "tests/support/program.h"

namespace curlew {
namespace {

namespace fs = std::filesystem;

struct Fault {
  const char* call;
  int error;                  ///< 0: a write takes half of the bytes
  const char* path = "made";  ///< what is in the path; empty for sockets
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
    const std::string replay = "replay ref.fits --sensor sensor.fits --save slopes,flux --out ";
    ASSERT_EQ(run_curlew(*good_, replay + "results.fits").exit_code, 0);
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
      for (const char* name : {"ref.fits", "long.fits", "sensor.fits", "results.fits"})
        fs::copy_file(*good_ / name, folder / name);
      const std::string mark = elsewhere / "mark";
      const ProgramRun run = run_curlew(
          folder, arguments, before + failing_call(fault.call, fault.error, at, fault.path, mark));
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

TEST_F(FaultsOnPurpose, WhatConvertAndExportMakeIsWholeOrNotThere) {
  struct Command {
    const char* arguments;
    std::size_t files;
  };
  for (const Command& command :
       {Command{"convert ref.fits --out made.fits", 1}, Command{"convert ref.fits --milk made", 2},
        Command{"export results.fits --aot --recording ref.fits --sensor sensor.fits --out "
                "made.fits",
                1}}) {
    SCOPED_TRACE(command.arguments);
    const int before = faults_;
    for (const Fault& fault :
         {Fault{"fopen", EMFILE}, Fault{"fwrite", ENOSPC}, Fault{"fclose", EIO},
          Fault{"write", ENOSPC}, Fault{"rename", EIO}}) {
      for_each_call(fault, 7, "", command.arguments,
                    [&](const ScratchDirectory& folder, const ProgramRun& run) {
                      std::size_t made = 0;
                      for (const auto& entry : fs::recursive_directory_iterator(folder / "."))
                        if (entry.is_regular_file() &&
                            entry.path().string().find("made") != std::string::npos)
                          ++made;
                      EXPECT_EQ(made, run.exit_code == 0 ? command.files : 0) << run.err;
                      if (run.exit_code == 0) return;
                      EXPECT_EQ(run.exit_code, 1);
                      EXPECT_EQ(std::count(run.err.begin(), run.err.end(), '\n'), 1) << run.err;
                      EXPECT_NE(run.err.find("made"), std::string::npos) << run.err;
                    });
    }
    EXPECT_GE(faults_, before + 8);
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

TEST_F(FaultsOnPurpose, StreamsAreThereOrTheDaemonSaysWhyNot) {
  const std::string prepare =
      "mkdir made; printf '[publish]\\nfolder = \"made\"\\nstreams = [\"slopes\"]\\n' >c.toml; ";
  for (const Fault& fault :
       {Fault{"open", EMFILE}, Fault{"posix_fallocate", ENOSPC}, Fault{"rename", EIO}}) {
    const int before = faults_;
    for_each_call(fault, 2, prepare,
                  "run --camera file:long.fits --sensor sensor.fits --config c.toml",
                  [&](const ScratchDirectory& folder, const ProgramRun& run) {
                    const bool there = fs::exists(folder / "made/curlew_slopes.im.shm");
                    EXPECT_EQ(run.exit_code == 0, there) << run.err;
                    EXPECT_FALSE(fs::exists(folder / "made/curlew_slopes.im.shm.new"));
                    if (there) return;
                    const std::string last = run.err.substr(run.err.rfind("curlew: "));
                    EXPECT_NE(last.find("made/curlew_slopes"), std::string::npos) << run.err;
                  });
    EXPECT_GT(faults_, before) << fault.call << " was never called";
  }
}

// What listens is made when the daemon starts. It listens then, or does not start, and says why.
TEST_F(FaultsOnPurpose, WhatCannotListenIsSaidAtTheStart) {
  const std::string prepare =
      "printf '[daemon]\\ncontrol = \"control\"\\n[metrics]\\nlisten = \"127.0.0.1:0\"\\n' "
      ">c.toml; NOTIFY_SOCKET=$PWD/none ";
  for (const Fault& fault :
       {Fault{"socket", EMFILE, ""}, Fault{"bind", EADDRINUSE, ""}, Fault{"listen", EADDRINUSE, ""},
        Fault{"connect", EINTR, ""}, Fault{"sendmsg", ENOBUFS, ""}}) {
    const int before = faults_;
    for_each_call(fault, 4, prepare,
                  "run --camera file:long.fits --sensor sensor.fits --config c.toml",
                  [&](const ScratchDirectory& folder, const ProgramRun& run) {
                    EXPECT_FALSE(fs::exists(folder / "control"));
                    if (run.exit_code == 0) {
                      EXPECT_EQ(number_before(run.out, " frames delivered"), 40) << run.out;
                      return;
                    }
                    EXPECT_EQ(run.exit_code, 1) << run.err;
                    const std::string last = run.err.substr(run.err.rfind("curlew: "));
                    EXPECT_EQ(std::count(last.begin(), last.end(), '\n'), 1) << last;
                    EXPECT_TRUE(last.find("socket") != std::string::npos ||
                                last.find("metrics: 127.0.0.1:0") != std::string::npos)
                        << last;
                  });
    EXPECT_GT(faults_, before) << fault.call << " was never called";
  }
}

}  // namespace
}  // namespace curlew
