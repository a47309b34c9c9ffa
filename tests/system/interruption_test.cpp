// Whatever the program waits for, SIGINT and SIGTERM end it within a second or so, with a sentence;
// and a wall clock that is set to another time disturbs nothing.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <thread>

#include "service/daemon/control_socket.h"
#include "tests/support/paths.h"
#include "tests/support/process.h"
#include "tests/support/program.h"
#include "tests/support/raw_fits.h"

namespace curlew {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using Clock = std::chrono::steady_clock;

class Interruption : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    good_ = std::make_unique<ScratchDirectory>();
    const std::string small = "--rows 6 --cols 6 --photons 2000 --frames 200 --out ref.fits";
    ASSERT_EQ(run_curlew(*good_, "simulate " + small).exit_code, 0);
    ASSERT_EQ(run_curlew(*good_, "calibrate ref.fits --out sensor.fits").exit_code, 0);
  }
  static void TearDownTestSuite() { good_.reset(); }

  std::unique_ptr<Process> start(const std::vector<std::string>& arguments,
                                 void (*before_exec)() = nullptr) {
    std::vector<std::string> command{kCurlewProgram};
    command.insert(command.end(), arguments.begin(), arguments.end());
    return std::make_unique<Process>(command, scratch_ / "out", scratch_ / "err", before_exec);
  }

  /// Expects that the signal ends the program soon, with this exit code and words.
  void expect_heard(Process& curlew, int signal, int exit_code, const std::string& words) {
    ASSERT_TRUE(curlew.running()) << "it must be waiting: " << curlew.err();
    const auto begin = Clock::now();
    curlew.signal(signal);
    EXPECT_EQ(curlew.wait(seconds(20)), exit_code) << curlew.err();
    // It takes a tenth of this on a machine of one's own.
    EXPECT_LT(Clock::now() - begin, seconds(3));
    EXPECT_NE(curlew.err().find(words), std::string::npos) << curlew.err();
  }

  std::string ref() const { return *good_ / "ref.fits"; }
  std::string sensor() const { return *good_ / "sensor.fits"; }

  static std::unique_ptr<ScratchDirectory> good_;
  ScratchDirectory scratch_;
};
std::unique_ptr<ScratchDirectory> Interruption::good_;

TEST_F(Interruption, APipeThatNobodyReads) {
  const std::string pipe = scratch_ / "pipe";
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  const auto curlew = start({"replay", ref(), "--sensor", sensor(), "--jsonl", pipe});
  ASSERT_TRUE(curlew->catches(SIGINT, seconds(20)));
  std::this_thread::sleep_for(milliseconds(300));
  expect_heard(*curlew, SIGINT, 1, "pipe cannot be written: nobody reads this pipe");
}

TEST_F(Interruption, APipeWhoseReaderStalls) {
  const std::string pipe = scratch_ / "pipe";
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  const int reader = open(pipe.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC);
  fcntl(reader, F_SETPIPE_SZ, 4096);
  const auto curlew = start({"replay", ref(), "--sensor", sensor(), "--jsonl", pipe});
  ASSERT_TRUE(curlew->catches(SIGTERM, seconds(20)));
  std::this_thread::sleep_for(milliseconds(500));
  expect_heard(*curlew, SIGTERM, 1, "pipe cannot be written: its reader does not read");
  close(reader);
}

/// Makes a cube of 2,170,138 frames of 48 x 48 pixels, which is a hole in the file.
void make_hole(const std::string& path, int bitpix) {
  const std::string header = raw_image_header(bitpix, {"48", "48", "2170138"});
  write_bytes(path, header);
  const std::int64_t bytes = 48LL * 48 * 2170138 * std::abs(bitpix) / 8;
  std::filesystem::resize_file(
      path, header.size() + static_cast<std::uintmax_t>((bytes + 2879) / 2880 * 2880));
}

// This is a float cube of 20 GB, all of which is looked at before the first frame.
TEST_F(Interruption, AFileOfManyGigabytes) {
  const std::string big = scratch_ / "big.fits";
  make_hole(big, -32);
  for (const bool calibrates : {false, true}) {
    const auto curlew =
        calibrates ? start({"calibrate", ref(), "--dark", big, "--out", scratch_ / "s.fits"})
                   : start({"replay", big, "--sensor", sensor()});
    ASSERT_TRUE(curlew->catches(SIGINT, seconds(20)));
    std::this_thread::sleep_for(milliseconds(500));
    expect_heard(*curlew, SIGINT, 1, "interrupted while");
  }
}

// Copying these 5 GB would take far longer than half a second.
TEST_F(Interruption, AConversionLeavesNoFile) {
  const std::string big = scratch_ / "big.fits";
  make_hole(big, 8);
  for (const bool for_milk : {false, true}) {
    const std::string out = scratch_ / "made";
    const auto curlew = start({"convert", big, for_milk ? "--milk" : "--out", out});
    ASSERT_TRUE(curlew->catches(SIGINT, seconds(20)));
    std::this_thread::sleep_for(milliseconds(500));
    expect_heard(*curlew, SIGINT, 1, "interrupted: " + out);
    if (!std::filesystem::exists(out)) continue;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(out))
      EXPECT_TRUE(entry.is_directory()) << entry.path();
  }
}

TEST_F(Interruption, ASimulationSaysHowFarItCame) {
  const std::string out = scratch_ / "out.fits";
  const auto curlew = start({"simulate", "--frames", "100000000", "--out", out});
  ASSERT_TRUE(curlew->catches(SIGINT, seconds(20)));
  std::this_thread::sleep_for(milliseconds(500));
  expect_heard(*curlew, SIGINT, 1, "interrupted: " + out + " holds the first ");
}

TEST_F(Interruption, AStoppedDaemonThatIsAsked) {
  // It listens, but nobody accepts; the queue is full after a few.
  const std::string path = scratch_ / "control";
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::strcpy(address.sun_path, path.c_str());
  const int listening = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  ASSERT_EQ(bind(listening, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  ASSERT_EQ(listen(listening, 0), 0);
  const auto first = start({"control", "status", "--socket", path});
  EXPECT_EQ(first->wait(seconds(20)), 1);
  EXPECT_NE(first->err().find("does not answer"), std::string::npos) << first->err();
  const auto second = start({"control", "status", "--socket", path});
  ASSERT_TRUE(second->catches(SIGINT, seconds(20)));
  second->signal(SIGINT);
  EXPECT_EQ(second->wait(seconds(20)), 1);
  EXPECT_NE(second->err().find("answer"), std::string::npos) << second->err();
  close(listening);
}

/// Makes standard error a pipe that is full, and that nobody reads.
void fill_stderr() {
  int ends[2];
  if (pipe(ends) != 0) _exit(126);
  fcntl(ends[1], F_SETFL, O_NONBLOCK);
  while (write(ends[1], "x", 1) == 1) continue;
  fcntl(ends[1], F_SETFL, 0);
  dup2(ends[1], STDERR_FILENO);
  // The reading end stays open in the program, so that the pipe is not broken.
}

TEST_F(Interruption, StandardErrorThatIsAFullPipe) {
  const auto curlew =
      start({"run", "--camera", "sim:vortex", "--jsonl", scratch_ / "a.jsonl"}, fill_stderr);
  ASSERT_TRUE(curlew->catches(SIGHUP, seconds(20)));
  const std::string lines = scratch_ / "a.jsonl";
  for (int i = 0;
       i < 200 && (!std::filesystem::exists(lines) || std::filesystem::file_size(lines) == 0); ++i)
    std::this_thread::sleep_for(milliseconds(50));
  const auto size = std::filesystem::file_size(lines);
  EXPECT_GT(size, 0U) << "a log that nobody reads must not hold results up";
  expect_heard(*curlew, SIGTERM, 0, "");
  const auto refused = start({"replay", "none.fits", "--sensor", sensor()}, fill_stderr);
  ASSERT_TRUE(refused->catches(SIGINT, seconds(20)));
  std::this_thread::sleep_for(milliseconds(200));
  expect_heard(*refused, SIGINT, 1, "");
}

/// The file that tells the preloaded clock by how much it is wrong.
class ClockShift {
 public:
  explicit ClockShift(const std::string& path) {
    write_bytes(path, std::string(sizeof(std::int64_t), '\0'));
    const int fd = open(path.c_str(), O_RDWR | O_CLOEXEC);
    shift_ = static_cast<volatile std::int64_t*>(
        mmap(nullptr, sizeof(std::int64_t), PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0));
    close(fd);
  }
  ~ClockShift() { munmap(const_cast<std::int64_t*>(shift_), sizeof(std::int64_t)); }
  ClockShift(const ClockShift&) = delete;
  ClockShift& operator=(const ClockShift&) = delete;
  void set(std::int64_t shift_s) { *shift_ = shift_s; }

 private:
  volatile std::int64_t* shift_;
};

TEST_F(Interruption, AWallClockThatIsSetDisturbsNothing) {
  ClockShift clock(scratch_ / "shift");
  const std::string notify = scratch_ / "notify";
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::strcpy(address.sun_path, notify.c_str());
  const int manager = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  ASSERT_EQ(bind(manager, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  const auto pings = [&] {
    int count = 0;
    std::array<char, 512> text{};
    for (ssize_t got = 0; (got = recv(manager, text.data(), text.size(), 0)) > 0;)
      count += std::string(text.data(), static_cast<std::size_t>(got)) == "WATCHDOG=1" ? 1 : 0;
    return count;
  };
  const std::string control = scratch_ / "control";
  std::filesystem::create_directory(scratch_ / "frames");
  write_bytes(scratch_ / "c.toml",
              "[daemon]\ncontrol = \"" + control +
                  "\"\n[camera]\nsource = \"sim:vortex\"\nframe_rate_hz = 200\n"
                  "[recorder]\nmode = \"continuous\"\nmin_free_mb = 0\n"
                  "folder = \"" +
                  (scratch_ / "frames") + "\"\n");
  Process curlew({"/usr/bin/env", "ASAN_OPTIONS=verify_asan_link_order=0",
                  std::string("LD_PRELOAD=") + kShiftedClock,
                  "CURLEW_CLOCK_SHIFT=" + (scratch_ / "shift"), "NOTIFY_SOCKET=" + notify,
                  "WATCHDOG_USEC=400000", kCurlewProgram, "run", "--config", scratch_ / "c.toml"},
                 scratch_ / "out", scratch_ / "err");
  ASSERT_TRUE(curlew.says("state=streaming", seconds(30))) << curlew.err();
  const auto status = [&](const char* what) {
    return nlohmann::json::parse(ask_daemon(control, "status"))[what].get<std::int64_t>();
  };
  for (const std::int64_t shift_s : {3600, -3600, 86400, -86400, 0}) {
    SCOPED_TRACE(shift_s);
    clock.set(shift_s);
    std::this_thread::sleep_for(milliseconds(200));
    pings();
    const std::int64_t results = status("results");
    const std::int64_t recorded = status("recorded");
    std::this_thread::sleep_for(milliseconds(700));
    EXPECT_GE(pings(), 2);
    EXPECT_GT(status("results"), results + 20);
    EXPECT_GT(status("recorded"), recorded);
  }
  const std::int64_t results = status("results");
  EXPECT_GE(results, status("recorded"));
  curlew.signal(SIGTERM);
  EXPECT_EQ(curlew.wait(seconds(20)), 0) << curlew.err();
  EXPECT_EQ(curlew.err().find("error"), std::string::npos) << curlew.err();
  close(manager);
}

}  // namespace
}  // namespace curlew
