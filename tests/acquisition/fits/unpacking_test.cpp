// What others packed is unpacked where it harms nobody: tiles in another process, gzip within a
// limit.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <random>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "acquisition/fits/confinement.h"
#include "acquisition/fits/file_descriptor.h"
#include "acquisition/fits/fits_file.h"
#include "acquisition/fits/unpacking_process.h"
#include "tests/support/failure_text.h"
#include "tests/support/raw_fits.h"
#include "tests/support/sanitized.h"
#include "tests/support/scratch_directory.h"

namespace curlew {
namespace {

constexpr std::int64_t kPackedFrames = 3;
constexpr std::int64_t kSide = 24;
constexpr std::int64_t kPackedPixels = kPackedFrames * kSide * kSide;

std::vector<std::uint16_t> noise() {
  std::mt19937 random(1);
  std::vector<std::uint16_t> pixels(kPackedPixels);
  for (auto& pixel : pixels) pixel = static_cast<std::uint16_t>(1000 + random() % 64);
  return pixels;
}

/// Writes a tile-compressed image and returns its bytes.
std::string compressed_image(const std::string& path) {
  FitsFile out = FitsFile::create(path);
  out.create_compressed_image(ElementType::kU16, {kPackedFrames, kSide, kSide});
  out.write_pixels<std::uint16_t>(0, noise());
  out.commit();
  return read_bytes(path);
}

template <typename T>
std::vector<T> read_all(const std::string& path, int hdu) {
  FitsFile file = FitsFile::open(path);
  file.select(hdu);
  std::vector<T> pixels(static_cast<std::size_t>(file.image().elements()));
  file.read_pixels(0, std::span(pixels));
  return pixels;
}

void pack(const std::string& bytes, const std::string& path) {
  gzFile out = gzopen(path.c_str(), "wb9");
  gzwrite(out, bytes.data(), static_cast<unsigned>(bytes.size()));
  gzclose(out);
}

std::string status_of(pid_t process) {
  std::ostringstream status;
  status << std::ifstream("/proc/" + std::to_string(process) + "/status").rdbuf();
  return status.str();
}

std::vector<pid_t> children() {
  std::vector<pid_t> found;
  const std::string parent = "PPid:\t" + std::to_string(getpid()) + "\n";
  for (const auto& entry : std::filesystem::directory_iterator("/proc")) {
    const pid_t process = std::atoi(entry.path().filename().c_str());
    if (process > 0 && status_of(process).find(parent) != std::string::npos)
      found.push_back(process);
  }
  return found;
}

TEST(Unpacking, PixelsComeBackAsTheyWere) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "rice.fits";
  const std::string bytes = compressed_image(path);
  EXPECT_EQ(read_all<std::uint16_t>(path, 1), noise());
  const std::vector<double> as_double = read_all<double>(path, 1);
  EXPECT_TRUE(std::equal(as_double.begin(), as_double.end(), noise().begin()));
  pack(bytes, scratch / "rice.fits.gz");
  EXPECT_EQ(read_all<std::uint16_t>(scratch / "rice.fits.gz", 1), noise());
}

TEST(Unpacking, AnyPartCanBeRead) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "rice.fits";
  compressed_image(path);
  FitsFile file = FitsFile::open(path);
  file.select(1);
  const std::vector<std::uint16_t> all = noise();
  for (const std::int64_t first : {0L, 5L, 600L, kPackedPixels - 7}) {
    std::vector<std::uint16_t> part(7);
    file.read_pixels(first, std::span(part));
    EXPECT_TRUE(std::equal(part.begin(), part.end(), all.begin() + first)) << first;
  }
}

TEST(Unpacking, AnotherProcessTakesThePlaceOfOneThatFailed) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "rice.fits";
  std::string bytes = compressed_image(path);
  // The rows of the table say how long the tiles are, and where.
  const std::size_t rows = bytes.rfind("END     ") / 2880 * 2880 + 2880;
  bytes.replace(rows + 8 * 2, 4, std::string("\x7f\xff\xff\xff", 4));
  write_bytes(path, bytes);
  FitsFile file = FitsFile::open(path);
  file.select(1);
  const std::vector<std::uint16_t> all = noise();
  std::vector<std::uint16_t> part(7);
  for (int time = 0; time < 2; ++time) {
    EXPECT_NE(failure_text([&] { file.read_pixels(kPackedPixels - 7, std::span(part)); }), "");
    file.read_pixels(0, std::span(part));
    EXPECT_TRUE(std::equal(part.begin(), part.end(), all.begin()));
  }
}

TEST(Unpacking, TheProcessMayDoLittleAndTakeLittleMemory) {
  if (kIsSanitized) GTEST_SKIP() << "a sanitizer forbids both limits";
  const ScratchDirectory scratch;
  const std::string path = scratch / "rice.fits";
  std::string bytes = compressed_image(path);
  FitsFile file = FitsFile::open(path);
  file.select(1);
  std::vector<std::uint16_t> part(7);
  file.read_pixels(0, std::span(part));
  int confined = 0;
  for (const pid_t child : children())
    confined += status_of(child).find("Seccomp:\t2\n") != std::string::npos ? 1 : 0;
  EXPECT_EQ(confined, 1);

  // One tile of 2^27 pixels, more than the process may hold.
  const auto set = [&](const std::string& key, const std::string& value) {
    std::string card = raw_card(key, value);
    const std::size_t at = bytes.find(card.substr(0, 9));
    ASSERT_NE(at, std::string::npos) << key;
    card.resize(80, ' ');
    std::copy(card.begin(), card.end(), bytes.begin() + static_cast<std::ptrdiff_t>(at));
  };
  for (const char* key : {"ZNAXIS1", "ZTILE1"}) set(key, "134217728");
  for (const char* key : {"NAXIS2", "ZNAXIS2", "ZNAXIS3"}) set(key, "1");
  write_bytes(path, bytes);
  FitsFile large = FitsFile::open(path);
  large.select(1);
  const std::string text = failure_text([&] { large.read_pixels(0, std::span(part)); });
  EXPECT_NE(text.find("too much memory"), std::string::npos) << text;
}

/// A compressed image of one tile, which takes a tenth of a second to unpack.
class LargeTile : public ::testing::Test {
 protected:
  static constexpr std::int64_t kPackedPixels = 1 << 24;

  void SetUp() override {
    FitsFile out = FitsFile::create(path_);
    out.create_compressed_image(ElementType::kU16, {1, 1, kPackedPixels});
    std::vector<std::uint16_t> pixels(kPackedPixels);
    std::mt19937 random(3);
    for (auto& pixel : pixels) pixel = static_cast<std::uint16_t>(random() % 64);
    out.write_pixels<std::uint16_t>(0, pixels);
    out.commit();
    file_ = FileDescriptor(open(path_.c_str(), O_RDONLY | O_CLOEXEC));
  }
  static UnpackingProcess::Request request(std::int32_t longest_ms) {
    constexpr std::int32_t kTushort = 20;  // cfitsio's number for unsigned short
    return {.hdu = 1,
            .datatype = kTushort,
            .bytes = 2,
            .elements = 1,
            .in_image = kPackedPixels,
            .longest_ms = longest_ms};
  }

  const ScratchDirectory scratch_;
  const std::string path_ = scratch_ / "tile.fits";
  FileDescriptor file_;
  std::array<std::byte, 2> pixel_{};
};

/// Returns the processor time that ended children of this process have taken.
std::chrono::microseconds time_of_children() {
  rusage usage{};
  getrusage(RUSAGE_CHILDREN, &usage);
  const auto time = [](const timeval& of) {
    return std::chrono::seconds(of.tv_sec) + std::chrono::microseconds(of.tv_usec);
  };
  return time(usage.ru_utime) + time(usage.ru_stime);
}

TEST_F(LargeTile, IsUnpackedInTheProcessorTimeThatItMayTake) {
  const auto time_of = [&](const UnpackingProcess::Request& request,
                           UnpackingProcess::Outcome expected) {
    const auto before = time_of_children();
    EXPECT_EQ(UnpackingProcess(file_.get()).read(request, pixel_), expected);
    EXPECT_EQ(children().size(), 0U);
    return time_of_children() - before;
  };
  time_of(request(60'000), UnpackingProcess::Outcome::kRead);
  UnpackingProcess::Request nothing = request(60'000);
  nothing.hdu = 9;
  const auto start = time_of(nothing, UnpackingProcess::Outcome::kDamaged);
  const auto stopped = time_of(request(20), UnpackingProcess::Outcome::kTooLong);
  // A process that is only no longer waited for computes for 200 ms.
  if (kSanitized) return;  // Starting takes long, and not always equally long.
  EXPECT_LT(stopped - start, std::chrono::milliseconds(100));
}

TEST_F(LargeTile, IsNotWaitedForWhereTheProcessHangs) {
  UnpackingProcess process(file_.get());
  ASSERT_EQ(process.read(request(60'000), pixel_), UnpackingProcess::Outcome::kRead);
  const std::vector<pid_t> started = children();
  ASSERT_EQ(started.size(), 1U);
  kill(started.front(), SIGSTOP);
  // Should it be waited for, it goes on after a while.
  std::atomic<bool> goes_on{false};
  std::jthread patience([&](const std::stop_token& stop) {
    for (int i = 0; i < 500 && !stop.stop_requested(); ++i)
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    goes_on = true;
    kill(started.front(), SIGCONT);
  });
  EXPECT_EQ(process.read(request(20), pixel_), UnpackingProcess::Outcome::kTooLong);
  EXPECT_FALSE(goes_on) << "it was waited for";
}

// Whatever the tiles hold, there are pixels or one sentence. In this process some of these bytes
// were a crash or an endless loop.
TEST(Unpacking, DamagedTilesAreOneSentence) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "damaged.fits";
  const std::string whole = compressed_image(path);
  const std::size_t heap = whole.rfind("END     ") / 2880 * 2880 + 2880 + 8 * kPackedFrames;
  std::mt19937 random(2);
  int failed = 0;
  for (const std::string method :
       {"'RICE_1'", "'GZIP_1'", "'GZIP_2'", "'PLIO_1'", "'HCOMPRESS_1'"}) {
    for (int trial = 0; trial < 6; ++trial) {
      std::string bytes = whole;
      std::string card = raw_card("ZCMPTYPE", method);
      card.resize(80, ' ');
      bytes.replace(bytes.find("ZCMPTYPE="), 80, card);
      for (std::size_t i = heap; i < heap + 200; ++i) bytes[i] = static_cast<char>(random());
      if (method == "'HCOMPRESS_1'") std::copy_n("\xdd\x99", 2, bytes.data() + heap);
      if (method.starts_with("'GZIP")) bytes.replace(heap, 4, std::string("\x1f\x8b\x08\x00", 4));
      write_bytes(path, bytes);
      const std::string text = failure_text([&] { read_all<std::uint16_t>(path, 1); });
      if (text.empty()) continue;
      ++failed;
      EXPECT_NE(text.find(path), std::string::npos) << text;
      EXPECT_EQ(text.find('\n'), std::string::npos) << text;
    }
  }
  EXPECT_GT(failed, 10);
}

TEST(Unpacking, GzipIsReadLikeThePlainFile) {
  const ScratchDirectory scratch;
  const std::string plain = raw_image_header(8, {"4", "3"}) + std::string(2880, '\7');
  pack(plain, scratch / "a.fits.gz");
  EXPECT_EQ(read_all<std::uint8_t>(scratch / "a.fits.gz", 0), std::vector<std::uint8_t>(12, 7));
  const std::string packed = read_bytes(scratch / "a.fits.gz");
  write_bytes(scratch / "cut.fits.gz", packed.substr(0, packed.size() / 2));
  EXPECT_NE(failure_text([&] { FitsFile::open(scratch / "cut.fits.gz"); }).find("damaged"),
            std::string::npos);
}

TEST(Unpacking, AGzipBombMeetsALimit) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "bomb.fits.gz";
  gzFile out = gzopen(path.c_str(), "wb1");
  const std::string head = raw_image_header(8, {"1000", "1000", "400"});
  gzwrite(out, head.data(), static_cast<unsigned>(head.size()));
  const std::string zeros(1'000'000, '\0');
  for (int i = 0; i < 300; ++i) gzwrite(out, zeros.data(), static_cast<unsigned>(zeros.size()));
  gzclose(out);
  EXPECT_LT(std::filesystem::file_size(path), 2'000'000U);
  const std::string text = failure_text([&] { FitsFile::open(path); });
  EXPECT_NE(text.find("unpacks to more than 256 MB"), std::string::npos) << text;
}

TEST(Unpacking, FilesOfCompressAreRefusedWithARemedy) {
  const ScratchDirectory scratch;
  write_bytes(scratch / "a.fits.Z", "\x1f\x9d\x90nonsense");
  EXPECT_NE(failure_text([&] { FitsFile::open(scratch / "a.fits.Z"); }).find("uncompress"),
            std::string::npos);
}

}  // namespace
}  // namespace curlew
