// Pixels that are read past cfitsio are those that cfitsio reads.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "acquisition/fits/fits_file.h"
#include "tests/support/failure_text.h"
#include "tests/support/scratch_directory.h"

namespace curlew {
namespace {

constexpr std::int64_t kFrames = 5;
constexpr std::int64_t kRows = 7;
constexpr std::int64_t kCols = 11;
constexpr std::int64_t kFrame = kRows * kCols;

/// Returns numbers from one end of T's range to the other.
template <typename T>
std::vector<T> numbers() {
  std::vector<T> pixels(static_cast<std::size_t>(kFrames * kFrame));
  for (std::size_t k = 0; k < pixels.size(); ++k) pixels[k] = static_cast<T>(k * 40503U + 77U);
  return pixels;
}

template <typename T>
std::string write_cube(const std::string& path, ElementType element) {
  FitsFile out = FitsFile::create(path);
  out.create_image(element, {kFrames, kRows, kCols});
  out.write_pixels<T>(0, numbers<T>());
  out.commit();
  return path;
}

template <typename T>
void expect_every_part(const std::string& path, const std::vector<T>& truth) {
  FitsFile file = FitsFile::open(path);
  for (const std::int64_t first : {0L, 1L, kFrame, 2 * kFrame, 3 * kFrame, kFrame + 5}) {
    std::vector<T> part(static_cast<std::size_t>(kFrame));
    std::vector<double> by_cfitsio(part.size());
    file.read_pixels(first, std::span(part));
    file.read_pixels(first, std::span(by_cfitsio));
    EXPECT_TRUE(std::equal(part.begin(), part.end(), truth.begin() + first)) << first;
    EXPECT_TRUE(std::equal(part.begin(), part.end(), by_cfitsio.begin())) << first;
  }
}

TEST(PlainPixels, AreThoseThatWereWritten) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "cube.fits";
  expect_every_part(write_cube<std::uint8_t>(path, ElementType::kU8), numbers<std::uint8_t>());
  expect_every_part(write_cube<std::uint16_t>(path, ElementType::kU16), numbers<std::uint16_t>());
  expect_every_part(write_cube<std::int16_t>(path, ElementType::kI16), numbers<std::int16_t>());
}

// 32767 − pixel covers the range of unsigned integers as well as pixel + 32768 does.
TEST(PlainPixels, KeepAScaleThatTheHeaderGives) {
  const ScratchDirectory scratch;
  const std::string path = write_cube<std::int16_t>(scratch / "cube.fits", ElementType::kI16);
  const std::string turned = scratch / "turned.fits";
  {
    FitsFile out = FitsFile::create(turned);
    out.create_image(ElementType::kI16, {kFrames, kRows, kCols});
    out.write_pixels<std::int16_t>(0, numbers<std::int16_t>());
    out.write_key("BZERO", 32767.0);
    out.write_key("BSCALE", -1.0);
    out.commit();
  }
  std::vector<std::uint16_t> truth;
  for (const std::int16_t pixel : numbers<std::int16_t>())
    truth.push_back(static_cast<std::uint16_t>(32767 - pixel));
  expect_every_part(turned, truth);
  expect_every_part(path, numbers<std::int16_t>());
}

TEST(PlainPixels, OfAnotherWidthAreConverted) {
  const ScratchDirectory scratch;
  FitsFile file = FitsFile::open(write_cube<std::uint8_t>(scratch / "cube.fits", ElementType::kU8));
  const std::vector<std::uint8_t> truth = numbers<std::uint8_t>();
  std::vector<std::int16_t> wider(truth.size());
  file.read_pixels(0, std::span(wider));
  EXPECT_TRUE(std::equal(wider.begin(), wider.end(), truth.begin()));
}

TEST(PlainPixels, BeyondTheImageAreRefused) {
  const ScratchDirectory scratch;
  FitsFile file =
      FitsFile::open(write_cube<std::uint16_t>(scratch / "cube.fits", ElementType::kU16));
  std::vector<std::uint16_t> part(static_cast<std::size_t>(kFrame));
  EXPECT_NE(failure_text([&] { file.read_pixels(kFrames * kFrame - 1, std::span(part)); }), "");
}

TEST(PlainPixels, AFileThatIsCutWhileItIsReadIsRefusedInASentence) {
  const ScratchDirectory scratch;
  const std::string path = write_cube<std::uint16_t>(scratch / "cube.fits", ElementType::kU16);
  FitsFile file = FitsFile::open(path);
  std::vector<std::uint16_t> part(static_cast<std::size_t>(kFrame));
  file.read_pixels(0, std::span(part));
  std::filesystem::resize_file(path, 2880 + 100);
  const std::string text = failure_text([&] { file.read_pixels(2 * kFrame, std::span(part)); });
  EXPECT_EQ(text, path + " cannot be read: it became shorter, or its disk fails");
}

// A process unpacks the frame after the one that was asked for; another may be asked for instead.
TEST(PlainPixels, CompressedFramesComeInAnyOrder) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "rice.fits";
  const std::vector<std::uint16_t> truth = numbers<std::uint16_t>();
  {
    FitsFile out = FitsFile::create(path);
    out.create_compressed_image(ElementType::kU16, {kFrames, kRows, kCols});
    out.write_pixels<std::uint16_t>(0, truth);
    out.commit();
  }
  FitsFile file = FitsFile::open(path);
  file.select(1);
  for (const std::int64_t frame : {0L, 1L, 2L, 4L, 2L, 3L, 4L, 0L, 1L, 1L, 2L}) {
    std::vector<std::uint16_t> part(static_cast<std::size_t>(kFrame));
    file.read_pixels(frame * kFrame, std::span(part));
    EXPECT_TRUE(std::equal(part.begin(), part.end(), truth.begin() + frame * kFrame)) << frame;
  }
}

}  // namespace
}  // namespace curlew
