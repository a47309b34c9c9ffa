// Streams in shared memory, as a reader sees them that was written in C after the format's offsets.
#include "service/publish/stream_writer.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <time.h>

#include <algorithm>
#include <cstring>
#include <fstream>
#include <sstream>
#include <thread>

#include "core/error.h"
#include "core/utc_now.h"
#include "tests/support/failure_text.h"
#include "tests/support/paths.h"
#include "tests/support/process.h"
#include "tests/support/scratch_directory.h"

namespace curlew {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr std::int64_t kNsPerS = 1'000'000'000;

StreamDescription slopes(std::uint32_t cols = 6, std::uint32_t rows = 2) {
  return {"test_slopes", StreamType::kF32, {cols, rows}, "rad/pitch", "N_VALID", "lenslets"};
}

/// Writes an update all of whose elements are `value`.
void write_update(StreamWriter& writer, float value, std::size_t elements = 12,
                  std::int64_t received_ns = utc_now_ns()) {
  auto* data = reinterpret_cast<float*>(writer.begin());
  std::fill_n(data, elements, value);
  const auto frame = static_cast<std::int64_t>(value);
  writer.end({frame, 100 + frame, received_ns, 0}, 6);
}

template <typename T>
T at(const std::string& file, std::size_t offset) {
  T value{};
  std::memcpy(&value, file.data() + offset, sizeof(T));
  return value;
}

std::int64_t inode(const std::string& path) {
  struct stat status {};
  stat(path.c_str(), &status);
  return static_cast<std::int64_t>(status.st_ino);
}

std::int64_t tai_now_ns() {
  timespec time{};
  clock_gettime(CLOCK_TAI, &time);
  return time.tv_sec * kNsPerS + time.tv_nsec;
}

/// What the reader in C prints of an update.
struct SeenUpdate {
  std::int64_t count = 0, acquired_ns = 0, written_ns = 0, frame = 0;
  double first = 0, last = 0, sum = 0;
};

std::vector<SeenUpdate> seen_updates(const std::string& text) {
  std::vector<SeenUpdate> updates;
  std::istringstream lines(text);
  for (SeenUpdate u;
       lines >> u.count >> u.acquired_ns >> u.written_ns >> u.frame >> u.first >> u.last >> u.sum;)
    updates.push_back(u);
  return updates;
}

class PublishedStreams : public ::testing::Test {
 protected:
  std::string file() const { return scratch_ / "test_slopes.im.shm"; }
  StreamWriter writer() const { return StreamWriter(scratch_.path(), slopes()); }
  std::unique_ptr<Process> reader(int semaphore, int updates) const {
    return std::make_unique<Process>(
        std::vector<std::string>{kStreamReader, file(), std::to_string(semaphore),
                                 std::to_string(updates)},
        scratch_ / "reader.out", scratch_ / "reader.err");
  }
  /// Returns the value of a semaphore of the file, which glibc has in its first four bytes.
  std::uint32_t posts(std::size_t semaphore) const {
    return at<std::uint32_t>(read_bytes(file()), kSemaphores + 32 * semaphore);
  }

  // 48 bytes of data, 7 keywords.
  static constexpr std::size_t kKeywords = 384 + 48;
  static constexpr std::size_t kSemaphores = kKeywords + 7 * 128;
  ScratchDirectory scratch_;
};

TEST_F(PublishedStreams, EveryFieldIsWhereTheFormatHasIt) {
  StreamWriter stream = writer();
  const std::int64_t received_ns = utc_now_ns();
  write_update(stream, 7.0F, 12, received_ns);
  write_update(stream, 8.0F, 12, received_ns);
  const std::string bytes = read_bytes(file());
  ASSERT_EQ(bytes.size(), kSemaphores + 11 * 32 + 4 * 40 + 10 * 64);
  EXPECT_STREQ(bytes.c_str(), "2.00");
  EXPECT_STREQ(bytes.c_str() + 32, "test_slopes");
  EXPECT_EQ(at<std::uint8_t>(bytes, 112), 2);
  EXPECT_EQ(at<std::uint32_t>(bytes, 116), 6U);
  EXPECT_EQ(at<std::uint32_t>(bytes, 120), 2U);
  EXPECT_EQ(at<std::uint64_t>(bytes, 128), 12U);
  EXPECT_EQ(at<std::uint8_t>(bytes, 136), 9);
  EXPECT_EQ(at<std::uint64_t>(bytes, 144) & 0xF000FU, 2U) << "it must not seem to be circular";
  EXPECT_EQ(at<std::int32_t>(bytes, 216), getpid());
  EXPECT_EQ(at<std::int32_t>(bytes, 220), getpid());
  EXPECT_EQ(at<std::uint8_t>(bytes, 224), 1);
  EXPECT_EQ(at<std::int64_t>(bytes, 232), inode(file()));
  EXPECT_EQ(at<std::int8_t>(bytes, 240), -1);
  EXPECT_EQ(at<std::uint16_t>(bytes, 258), 10);
  EXPECT_EQ(at<std::uint16_t>(bytes, 260), 10);
  EXPECT_EQ(at<std::uint64_t>(bytes, 264), 2U);
  EXPECT_EQ(at<std::uint8_t>(bytes, 288), 0);
  EXPECT_EQ(at<std::uint16_t>(bytes, 290), 7);
  EXPECT_EQ(at<std::uint64_t>(bytes, 312), 48U);
  for (std::size_t i = 0; i < 12; ++i) EXPECT_EQ(at<float>(bytes, 384 + 4 * i), 8.0F);
  for (std::size_t i = 0; i < 10; ++i) EXPECT_EQ(posts(i), 2U) << i;
  for (std::size_t i = 0; i < 20; ++i)
    EXPECT_EQ(at<std::int32_t>(bytes, kSemaphores + 11 * 32 + 4 * i), -1) << i;
  const char* const names[] = {"CREATOR", "FRAME", "SEQUENCE", "_MAQTIME",
                               "STATUS",  "UNIT",  "N_VALID"};
  for (std::size_t i = 0; i < 7; ++i) EXPECT_STREQ(bytes.c_str() + kKeywords + 128 * i, names[i]);
  const auto number = [&](std::size_t keyword) {
    return at<std::int64_t>(bytes, kKeywords + 128 * keyword + 24);
  };
  EXPECT_EQ(number(1), 8);
  EXPECT_EQ(number(2), 108);
  EXPECT_EQ(number(3), received_ns / 1000);
  EXPECT_STREQ(bytes.c_str() + kKeywords + 128 * 5 + 24, "rad/pitch");
  EXPECT_EQ(number(6), 6);
}

TEST_F(PublishedStreams, TimesAreInTai) {
  StreamWriter stream = writer();
  timespec utc{};
  clock_gettime(CLOCK_REALTIME, &utc);
  const std::int64_t before_ns = tai_now_ns();
  const std::int64_t leap_s =
      (before_ns - utc.tv_sec * kNsPerS - utc.tv_nsec + kNsPerS / 2) / kNsPerS;
  const std::int64_t received_ns = 1'800'000'000'123'456'789;
  write_update(stream, 1.0F, 12, received_ns);
  const std::string bytes = read_bytes(file());
  EXPECT_EQ(at<std::int64_t>(bytes, 184) * kNsPerS + at<std::int64_t>(bytes, 192),
            received_ns + leap_s * kNsPerS);
  const std::int64_t written =
      at<std::int64_t>(bytes, 200) * kNsPerS + at<std::int64_t>(bytes, 208);
  EXPECT_GE(written, before_ns);
  EXPECT_LE(written, tai_now_ns());
}

// The writer goes on at its pace while a reader reads, stops, dies and comes again.
TEST_F(PublishedStreams, AReaderInCWakesForEveryUpdateAndNeverStallsTheWriter) {
  StreamWriter stream = writer();
  auto first = reader(3, 1000);
  float value = 0.0F;
  std::int64_t longest_ns = 0;
  const auto write = [&](int updates) {
    for (int i = 0; i < updates; ++i) {
      const auto begin = std::chrono::steady_clock::now();
      write_update(stream, ++value);
      const std::chrono::nanoseconds took = std::chrono::steady_clock::now() - begin;
      longest_ns = std::max<std::int64_t>(longest_ns, took.count());
      std::this_thread::sleep_for(milliseconds(2));
    }
  };
  while (at<std::int32_t>(read_bytes(file()), kSemaphores + 11 * 32 + 12) != first->pid())
    std::this_thread::sleep_for(milliseconds(2));
  write(50);
  first->signal(SIGSTOP);
  write(50);
  EXPECT_EQ(posts(3), 10U) << "nobody takes them, so no more are posted";
  first->signal(SIGKILL);
  EXPECT_EQ(first->wait(seconds(10)), 128 + SIGKILL);
  const std::vector<SeenUpdate> seen = seen_updates(first->out());
  ASSERT_GE(seen.size(), 49U) << first->out();
  for (std::size_t i = 0; i < seen.size(); ++i) {
    // There is a post for every update since the first; a reader that wakes late sees the newest.
    EXPECT_GE(seen[i].count, static_cast<std::int64_t>(i) + 1);
    if (i > 0) {
      EXPECT_GE(seen[i].count, seen[i - 1].count);
    }
    EXPECT_EQ(seen[i].frame, seen[i].count);
    EXPECT_EQ(seen[i].first, static_cast<double>(seen[i].count));
    EXPECT_EQ(seen[i].sum, 12.0 * seen[i].last) << "of one update only";
    EXPECT_GE(seen[i].written_ns, seen[i].acquired_ns);
  }
  const auto second = reader(3, 20);
  write(60);
  EXPECT_EQ(second->wait(seconds(10)), 0) << "the posts that the dead one left, and new ones";
  EXPECT_GE(seen_updates(second->out()).size(), 10U);
  EXPECT_LT(longest_ns, kNsPerS) << "a writer that waits for its reader would wait for ever";
}

TEST_F(PublishedStreams, AFileOfTheSameShapeIsUsedOn) {
  {
    StreamWriter stream = writer();
    write_update(stream, 1.0F);
    stream.begin();  // and it dies in the middle of an update
  }
  const std::int64_t before = inode(file());
  StreamWriter stream = writer();
  EXPECT_EQ(inode(file()), before);
  EXPECT_EQ(at<std::uint8_t>(read_bytes(file()), 288), 0);
  write_update(stream, 2.0F);
  EXPECT_EQ(at<std::uint64_t>(read_bytes(file()), 264), 2U) << "the counter must go on";
}

TEST_F(PublishedStreams, AFileOfAnotherShapeIsReplaced) {
  { StreamWriter stream = writer(); }
  const std::int64_t before = inode(file());
  StreamWriter stream(scratch_.path(), slopes(8, 3));
  EXPECT_NE(inode(file()), before);
  write_update(stream, 1.0F, 24);
  EXPECT_EQ(at<std::uint32_t>(read_bytes(file()), 116), 8U);
  EXPECT_EQ(scratch_.names(), std::vector<std::string>{"test_slopes.im.shm"});
}

TEST_F(PublishedStreams, RefusesWhatIsNotItsOwn) {
  const auto refusal = [&](const std::string& folder) {
    return failure_text([&] { StreamWriter stream(folder, slopes()); });
  };
  {
    StreamWriter stream = writer();
    EXPECT_NE(refusal(scratch_.path()).find("is written by a Curlew that runs"), std::string::npos);
  }
  std::string foreign = read_bytes(file());
  foreign.replace(kKeywords + 24, 6, "cacao\0", 6);
  write_bytes(file(), foreign);
  EXPECT_NE(refusal(scratch_.path()).find("belongs to another program"), std::string::npos);
  write_bytes(file(), "not a stream");
  EXPECT_NE(refusal(scratch_.path()).find("remove it if nobody needs it"), std::string::npos);
  EXPECT_NE(refusal(scratch_ / "missing").find("make the folder"), std::string::npos);
}

}  // namespace
}  // namespace curlew
