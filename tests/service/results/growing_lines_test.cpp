// The daemon's JSON lines live as long as it does: through full disks, readers that go away, files
// that are moved, and rotation. A reader of a file never meets half a line.
#include "service/results/growing_lines.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <filesystem>
#include <functional>
#include <thread>

#include "core/error.h"
#include "tests/support/eventually.h"
#include "tests/support/scratch_directory.h"

namespace curlew {
namespace {

namespace fs = std::filesystem;

std::string line(int number) { return "{\"frame\":" + std::to_string(number) + "}\n"; }

TEST(GrowingLines, AppendsAndCutsOffTheHalfLineOfAKilledProcess) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "a.jsonl";
  const std::string half = "{\"frame\":2,\"vort";
  write_bytes(path, line(0) + line(1) + half);
  GrowingLines lines(path, {});
  EXPECT_TRUE(lines.write(line(2)));
  EXPECT_EQ(read_bytes(path), line(0) + line(1) + line(2));
  write_bytes(scratch / "half.jsonl", half);
  GrowingLines other(scratch / "half.jsonl", {});
  EXPECT_TRUE(other.write(line(3)));
  EXPECT_EQ(read_bytes(scratch / "half.jsonl"), line(3));
}

TEST(GrowingLines, LeavesAFileAloneThatHoldsSomethingElse) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "sensor.fits";
  write_bytes(path, "SIMPLE  =                    T");
  EXPECT_THROW(GrowingLines(path, {}), Failure);
  EXPECT_EQ(read_bytes(path), "SIMPLE  =                    T");
  EXPECT_THROW(GrowingLines(scratch.path(), {}), Failure);
  EXPECT_THROW(GrowingLines(scratch / "none/a.jsonl", {}), Failure);
}

TEST(GrowingLines, RotatesBySizeAndKeepsTheNewestFiles) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "a.jsonl";
  JsonLinesOptions options;
  options.max_mb = 1;
  options.keep_files = 2;
  GrowingLines lines(path, options);
  // Each of these is a quarter of a megabyte.
  const auto quarter = [](int n) {
    return "{\"frame\":" + std::to_string(n) + std::string(249'986, ' ') + "}\n";
  };
  for (int n = 0; n < 18; ++n) ASSERT_TRUE(lines.write(quarter(n)));
  EXPECT_EQ(scratch.names(), (std::vector<std::string>{"a.jsonl", "a.jsonl.1", "a.jsonl.2"}));
  std::string all;
  for (const char* name : {"a.jsonl.2", "a.jsonl.1", "a.jsonl"}) all += read_bytes(scratch / name);
  std::string expected;
  for (int n = 0; n < 18; ++n) expected += quarter(n);
  EXPECT_TRUE(expected.ends_with(all)) << "the newest lines, in their order, without a gap";
  EXPECT_GE(all.size(), 2'000'000U);
}

TEST(GrowingLines, RotatesByAge) {
  const ScratchDirectory scratch;
  JsonLinesOptions options;
  options.max_s = 0.05;
  GrowingLines lines(scratch / "a.jsonl", options);
  ASSERT_TRUE(lines.write(line(0)));
  std::this_thread::sleep_for(std::chrono::milliseconds(80));
  ASSERT_TRUE(lines.write(line(1)));
  EXPECT_EQ(read_bytes(scratch / "a.jsonl.1"), line(0));
  EXPECT_EQ(read_bytes(scratch / "a.jsonl"), line(1));
}

TEST(GrowingLines, AFileThatWasMovedOrRemovedIsBegunAnew) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "a.jsonl";
  GrowingLines lines(path, {});
  ASSERT_TRUE(lines.write(line(0)));
  fs::rename(path, scratch / "old.jsonl");
  ASSERT_TRUE(lines.write(line(1)));
  EXPECT_EQ(read_bytes(scratch / "old.jsonl"), line(0));
  EXPECT_EQ(read_bytes(path), line(1));
  fs::remove(path);
  ASSERT_TRUE(lines.write(line(2)));
  EXPECT_EQ(read_bytes(path), line(2));
}

TEST(GrowingLines, AFullDiskLeavesNoHalfLineAndItGoesOnWhenThereIsRoom) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "a.jsonl";
  GrowingLines lines(path, {});
  ASSERT_TRUE(lines.write(line(0)));
  // A limit on the file's size stands in for a full disk.
  signal(SIGXFSZ, SIG_IGN);
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  const rlimit full{20, before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &full), 0);
  const bool written = lines.write(line(1) + line(2));
  setrlimit(RLIMIT_FSIZE, &before);
  EXPECT_FALSE(written);
  EXPECT_NE(lines.trouble().find("a.jsonl cannot be written"), std::string::npos);
  EXPECT_EQ(read_bytes(path), line(0));
  EXPECT_FALSE(lines.write(line(3))) << "it must not try at each line";
  ASSERT_TRUE(eventually([&] { return lines.write(line(4)); }));
  EXPECT_EQ(read_bytes(path), line(0) + line(4));
}

TEST(GrowingLines, APipeMayGetItsReaderLaterAndLoseIt) {
  const ScratchDirectory scratch;
  signal(SIGPIPE, SIG_IGN);
  const std::string path = scratch / "pipe";
  ASSERT_EQ(mkfifo(path.c_str(), 0600), 0);
  GrowingLines lines(path, {});
  EXPECT_FALSE(lines.write(line(0)));
  EXPECT_NE(lines.trouble().find("nobody reads this pipe"), std::string::npos);
  for (int reader = 0; reader < 2; ++reader) {
    const int fd = open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC);
    ASSERT_GE(fd, 0);
    int number = 100 * reader;
    ASSERT_TRUE(eventually([&] { return lines.write(line(++number)); }));
    std::array<char, 200> text{};
    const ssize_t count = read(fd, text.data(), text.size());
    EXPECT_EQ(std::string(text.data(), static_cast<std::size_t>(std::max<ssize_t>(count, 0))),
              line(number));
    close(fd);
    EXPECT_FALSE(lines.write(line(1000)));
  }
}

TEST(GrowingLines, AReaderThatStallsIsNotWaitedForAtTheEnd) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "pipe";
  ASSERT_EQ(mkfifo(path.c_str(), 0600), 0);
  const int fd = open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC);
  GrowingLines lines(path, {});
  std::thread end([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    lines.give_up();
  });
  bool written = true;
  for (int n = 0; n < 100'000 && written; ++n) written = lines.write(line(n));
  end.join();
  EXPECT_FALSE(written);
  close(fd);
}

}  // namespace
}  // namespace curlew
