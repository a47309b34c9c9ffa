#include "acquisition/recording/growing_recording.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <stdio.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <csignal>
#include <filesystem>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "acquisition/recording/compressed_recording.h"
#include "acquisition/recording/fits_source.h"
#include "acquisition/recording/recording.h"
#include "tests/support/failure_text.h"
#include "tests/support/found_recordings.h"
#include "tests/support/numbered_frames.h"
#include "tests/support/scratch_directory.h"

// If a test asks for it, the process ends in its n-th change of a file.
namespace {

struct Death {
  long changes_left = std::numeric_limits<long>::max();
  bool halfway = false;  // The last change is half done.
};
Death death;

void change(int fd, const void* bytes, size_t n, off_t offset) {
  if (death.changes_left-- > 0) return;
  if (death.halfway && bytes != nullptr) {
    [[maybe_unused]] const long result = syscall(SYS_pwrite64, fd, bytes, n / 2, offset);
  }
  _exit(9);
}

}  // namespace

extern "C" {
ssize_t pwrite(int fd, const void* bytes, size_t n, off_t offset) {
  change(fd, bytes, n, offset);
  return syscall(SYS_pwrite64, fd, bytes, n, offset);
}
int ftruncate(int fd, off_t length) noexcept {
  change(fd, nullptr, 0, 0);
  return static_cast<int>(syscall(SYS_ftruncate, fd, length));
}
int renameat2(int from_directory, const char* from, int to_directory, const char* to,
              unsigned flags) noexcept {
  change(-1, nullptr, 0, 0);
  return static_cast<int>(syscall(SYS_renameat2, from_directory, from, to_directory, to, flags));
}
}

namespace curlew {
namespace {

FrameFormat format_of(int rows, int cols, PixelType type) {
  FrameFormat format;
  format.rows = rows;
  format.cols = cols;
  format.pixel_type = type;
  return format;
}

const std::vector<FrameFormat> kFormats{
    format_of(5, 7, PixelType::kU8),        // A frame is smaller than the table.
    format_of(37, 53, PixelType::kU16),     // A frame is a bit more than a block.
    format_of(160, 200, PixelType::kU16)};  // A frame is much larger than the table.

/// Appends the frames from `from` to `to`, the last not included.
void append_numbered(GrowingRecording& recording, const FrameFormat& format, std::int64_t from,
                     std::int64_t to) {
  FrameBuffer frame(format);
  for (std::int64_t n = from; n < to; ++n) {
    fill_numbered(frame, n);
    recording.append(frame.view(), frame.header);
  }
}

std::unique_ptr<GrowingRecording> begin(const std::string& path, const FrameFormat& format) {
  return std::make_unique<GrowingRecording>(path, format, Optics{.pitch_m = 1.5e-4},
                                            Detector{.bit_depth = 12}, "curlew 0.0 test");
}

/// Returns how many frames replay. Checks that each has the right pixels and, if `has_table`, the
/// right header.
std::int64_t replayed(const std::string& path, bool has_table) {
  FitsSource source({path});
  EXPECT_EQ(source.optics().pitch_m, 1.5e-4);
  EXPECT_EQ(source.detector().bit_depth, 12);
  FrameBuffer frame(source.format());
  FrameBuffer expected(source.format());
  std::int64_t n = 0;
  for (; source.next(frame) == Delivery::kFrame; ++n) {
    EXPECT_TRUE(is_numbered(frame, n)) << path << " frame " << n;
    EXPECT_EQ(frame.header.sequence, n) << path;
    if (!has_table) continue;
    fill_numbered(expected, n);
    EXPECT_EQ(frame.header.camera_ns, expected.header.camera_ns) << path;
    EXPECT_EQ(frame.header.received_ns, expected.header.received_ns) << path;
    EXPECT_EQ(frame.header.status, expected.header.status) << path;
  }
  EXPECT_EQ(n, source.frame_count());
  return n;
}

bool has_frame_table(const std::string& path) { return FitsFile::open(path).try_select("FRAMES"); }

TEST(GrowingRecording, EndsAsTheFileThatRecordingWriterMakes) {
  for (const FrameFormat& format : kFormats) {
    const ScratchDirectory scratch;
    {
      const auto recording = begin(scratch / "rec.fits", format);
      std::int64_t from = 0;
      for (const std::int64_t to : {1, 2, 40, 40, 150}) {
        append_numbered(*recording, format, from, to);
        EXPECT_EQ(recording->frames(), to);
        EXPECT_EQ(recording->committed(), from);
        recording->commit();
        EXPECT_EQ(recording->committed(), to);
        // While the file grows it must be whole for readers.
        EXPECT_EQ(replayed(scratch / "rec.fits", true), to);
        from = to;
      }
      append_numbered(*recording, format, from, from + 3);
      EXPECT_EQ(replayed(scratch / "rec.fits", true), 150);
    }  // The last 3 were not committed.
    RecordingWriter writer(scratch / "expected.fits", format, Optics{.pitch_m = 1.5e-4},
                           Detector{.bit_depth = 12}, "curlew 0.0 test");
    FrameBuffer frame(format);
    for (std::int64_t n = 0; n < 150; ++n) {
      fill_numbered(frame, n);
      writer.append(frame.view(), frame.header);
    }
    writer.commit();
    std::string bytes = read_bytes(scratch / "rec.fits");
    const std::string expected = read_bytes(scratch / "expected.fits");
    EXPECT_EQ(bytes.size(), expected.size());
    EXPECT_TRUE(bytes == expected) << "both files must have the same bytes";
  }
}

TEST(GrowingRecording, IsReadableWheneverTheProcessDies) {
  const ScratchDirectory scratch;
  struct Progress {
    std::atomic<std::int64_t> appended{0};
    std::atomic<std::int64_t> committed{0};
  };
  void* shared =
      mmap(nullptr, sizeof(Progress), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  ASSERT_NE(shared, MAP_FAILED);
  constexpr int kCommits = 5;
  int files = 0;
  int without_table = 0;
  for (const FrameFormat& format : kFormats) {
    bool finished = false;
    for (int changes = 0; !finished; ++changes) {
      for (const bool halfway : {false, true}) {
        const std::string path =
            scratch / ("cols" + std::to_string(format.cols) + "_change" + std::to_string(changes) +
                       (halfway ? "_half" : "") + ".fits");
        auto* progress = new (shared) Progress;
        const pid_t child = fork();
        ASSERT_GE(child, 0);
        if (child == 0) {
          death = {changes, halfway};
          auto recording = begin(path, format);
          for (int commit = 0; commit < kCommits; ++commit) {
            // Commits are of one frame and of seven in turn.
            const std::int64_t to = progress->appended + (commit % 2 == 0 ? 1 : 7);
            for (; progress->appended < to; ++progress->appended) {
              append_numbered(*recording, format, progress->appended, progress->appended + 1);
            }
            recording->commit();
            progress->committed.store(recording->committed());
          }
          recording.reset();
          _exit(0);
        }
        int status = 0;
        ASSERT_EQ(waitpid(child, &status, 0), child);
        ASSERT_TRUE(WIFEXITED(status));
        finished = WEXITSTATUS(status) == 0;
        ASSERT_TRUE(finished || WEXITSTATUS(status) == 9)
            << "the child died otherwise than the test asked for";
        if (!std::filesystem::exists(path)) {
          EXPECT_EQ(progress->committed, 0) << path;
          continue;
        }
        ++files;
        const bool has_table = has_frame_table(path);
        if (!has_table) ++without_table;
        const std::int64_t frames = replayed(path, has_table);
        EXPECT_GE(frames, progress->committed) << path;
        EXPECT_LE(frames, progress->appended) << path;
        EXPECT_GT(frames, 0) << path;
      }
    }
  }
  munmap(shared, sizeof(Progress));
  EXPECT_GT(files, 100);
  // A file is without its table only if the process dies in one of a commit's last two changes:
  // when the bytes where the old table was are half written, or when NAXIS3 is not written or half
  // written.
  constexpr int kWeakMoments = 3 * kCommits;
  EXPECT_GT(without_table, 0) << "no process died in one of the moments without a table";
  EXPECT_LE(without_table, kWeakMoments * static_cast<int>(kFormats.size()));

  const PeerAnswer answer = ask_astropy("recordings", scratch.path());
  if (answer.exit_code == 77) GTEST_SKIP() << "astropy is not installed";
  ASSERT_EQ(answer.exit_code, 0) << answer.text;
  const std::vector<FoundRecording> found = found_recordings(answer);
  EXPECT_EQ(static_cast<int>(found.size()), files) << answer.text;
  int without_table_there = 0;
  int longer_tables = 0;
  int longer_files = 0;
  for (const FoundRecording& recording : found) {
    EXPECT_EQ(recording.wrong, 0) << recording.name;
    if (recording.rows < 0) {
      ++without_table_there;
      continue;
    }
    EXPECT_GE(recording.rows, recording.frames) << recording.name;
    if (recording.rows > recording.frames) ++longer_tables;
    EXPECT_EQ(recording.last, recording.frames - 1) << recording.name;
    if (recording.warnings > 0) ++longer_files;
  }
  EXPECT_EQ(without_table_there, without_table);
  // If a few small frames do not move the table, the next table is there before NAXIS3 counts its
  // frames.
  EXPECT_LE(longer_tables, kWeakMoments);
  // The next UNFINISHED ends later than the old one, and the file gets longer before the old one is
  // replaced.
  EXPECT_LE(longer_files, kWeakMoments * static_cast<int>(kFormats.size()));
}

TEST(GrowingRecording, CommitsByItselfBeforeItsSpaceEnds) {
  const ScratchDirectory scratch;
  const FrameFormat format = format_of(1000, 1000, PixelType::kU16);
  const auto recording = begin(scratch / "rec.fits", format);
  append_numbered(*recording, format, 0, 60);  // 120 MB
  EXPECT_GT(recording->committed(), 20);
  EXPECT_LT(recording->committed(), 60);
  EXPECT_EQ(replayed(scratch / "rec.fits", true), recording->committed());
}

TEST(GrowingRecording, AppearsWithItsFirstFrameAndLeavesNothingWithoutOne) {
  const ScratchDirectory scratch;
  {
    const auto recording = begin(scratch / "rec.fits", kFormats[0]);
    recording->commit();
    EXPECT_FALSE(std::filesystem::exists(scratch / "rec.fits"));
    append_numbered(*recording, kFormats[0], 0, 1);
  }
  EXPECT_TRUE(scratch.names().empty());
}

TEST(GrowingRecording, NeverOverwrites) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "rec.fits";
  const auto late = begin(path, kFormats[0]);
  write_bytes(path, "precious");
  EXPECT_NE(failure_text([&] { begin(path, kFormats[0]); }).find(path), std::string::npos);
  append_numbered(*late, kFormats[0], 0, 1);
  EXPECT_NE(failure_text([&] { late->commit(); }).find(path), std::string::npos);
  EXPECT_EQ(read_bytes(path), "precious");
  EXPECT_EQ(late->committed(), 0);
}

TEST(GrowingRecording, RefusesWhatIsNoFolderAndWhatIsNoFrameOfIts) {
  const ScratchDirectory scratch;
  EXPECT_NE(failure_text([&] { begin(scratch / "no/rec.fits", kFormats[0]); }).find("no/rec.fits"),
            std::string::npos);
  const auto recording = begin(scratch / "rec.fits", kFormats[0]);
  EXPECT_NE(failure_text([&] { append_numbered(*recording, kFormats[1], 0, 1); }).find("rec.fits"),
            std::string::npos);
  FrameFormat scaled = kFormats[0];
  scaled.scale_adu = 0.5;
  EXPECT_NE(failure_text([&] { begin(scratch / "b.fits", scaled); }).find("ADU"),
            std::string::npos);
}

// A limit on the size of files refuses writes as a full disk does.
TEST(GrowingRecording, AWriteErrorLeavesTheLastCommit) {
  const ScratchDirectory scratch;
  const FrameFormat format = kFormats[2];
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  {
    const auto recording = begin(scratch / "rec.fits", format);
    append_numbered(*recording, format, 0, 10);
    recording->commit();
    const rlimit limit{std::filesystem::file_size(scratch / "rec.fits") - (60U << 20U),
                       before.rlim_max};
    setrlimit(RLIMIT_FSIZE, &limit);
    EXPECT_NE(failure_text([&] { append_numbered(*recording, format, 10, 200); }).find("rec.fits"),
              std::string::npos);
    EXPECT_EQ(recording->committed(), 10);
    EXPECT_GT(recording->frames(), 11);
  }
  setrlimit(RLIMIT_FSIZE, &before);
  std::signal(SIGXFSZ, handler);
  EXPECT_EQ(replayed(scratch / "rec.fits", true), 10);
  EXPECT_LT(std::filesystem::file_size(scratch / "rec.fits"), 11 * format.bytes() + 5 * 2880);
}

TEST(CompressedRecording, IsTheSameToTheBit) {
  const ScratchDirectory scratch;
  for (const FrameFormat& format : kFormats) {
    const std::string name = "cols" + std::to_string(format.cols) + ".fits";
    const auto recording = begin(scratch / name, format);
    append_numbered(*recording, format, 0, 30);
    recording->commit();
    EXPECT_TRUE(compress_recording(scratch / name, scratch / (name + ".fz"), "test", {}));
    EXPECT_EQ(replayed(scratch / (name + ".fz"), true), 30);
    EXPECT_EQ(FitsSource({scratch / (name + ".fz")}).format().pixel_type, format.pixel_type);
  }
  const PeerAnswer answer = ask_astropy("recordings", scratch.path());
  if (answer.exit_code == 77) GTEST_SKIP() << "astropy is not installed";
  ASSERT_EQ(answer.exit_code, 0) << answer.text;
  const auto found = found_recordings(answer);
  EXPECT_EQ(found.size(), 2 * kFormats.size());
  for (const FoundRecording& recording : found) {
    EXPECT_EQ(recording.frames, 30) << recording.name;
    EXPECT_EQ(recording.rows, 30) << recording.name;
    EXPECT_EQ(recording.wrong, 0) << recording.name;
    EXPECT_EQ(recording.warnings, 0) << recording.name << "\n" << answer.text;
  }
}

TEST(CompressedRecording, LeavesNothingWhereItIsStopped) {
  const ScratchDirectory scratch;
  {
    const auto recording = begin(scratch / "rec.fits", kFormats[1]);
    append_numbered(*recording, kFormats[1], 0, 30);
    recording->commit();
  }
  std::stop_source stop;
  stop.request_stop();
  EXPECT_FALSE(
      compress_recording(scratch / "rec.fits", scratch / "rec.fits.fz", "test", stop.get_token()));
  EXPECT_EQ(scratch.names(), std::vector<std::string>{"rec.fits"});
}

}  // namespace
}  // namespace curlew
