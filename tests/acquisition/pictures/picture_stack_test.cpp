// Frames of PNG, TIFF and npy files are read value by value; whatever is no frame is refused in one
// sentence, and damaged files do no harm.
#include "acquisition/pictures/picture_stack.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <random>

#include "acquisition/pictures/png_file.h"
#include "acquisition/recording/fits_source.h"
#include "acquisition/recording/mean_image.h"
#include "acquisition/recording/recording.h"
#include "tests/acquisition/pictures/written_pictures.h"
#include "tests/support/failure_text.h"

namespace curlew {
namespace {

constexpr int kPictureRows = 5;
constexpr int kPictureCols = 21;  // more than one tile of 16
constexpr std::size_t kPicturePixels = std::size_t{kPictureRows} * kPictureCols;

/// Returns values of which no two neighbours are alike and that use both bytes.
template <typename T>
std::vector<T> numbered(std::size_t n, double step) {
  std::vector<T> values(n);
  for (std::size_t i = 0; i < n; ++i) values[i] = static_cast<T>(step * static_cast<double>(i));
  return values;
}

template <typename T>
void expect_frames(const std::string& path, ElementType element, const std::vector<T>& values) {
  PictureStack stack(path);
  EXPECT_EQ(stack.format().rows, kPictureRows);
  EXPECT_EQ(stack.format().cols, kPictureCols);
  EXPECT_EQ(stack.format().element, element);
  ASSERT_EQ(static_cast<std::size_t>(stack.format().frames) * kPicturePixels, values.size())
      << path;
  std::vector<double> frame(kPicturePixels);
  for (std::int64_t n = stack.format().frames - 1; n >= 0; --n) {  // in any order
    stack.read(n, {0, 0, kPictureCols, kPictureRows}, std::span(frame));
    for (std::size_t i = 0; i < kPicturePixels; ++i)
      ASSERT_EQ(frame[i],
                static_cast<double>(values[static_cast<std::size_t>(n) * kPicturePixels + i]))
          << path << " frame " << n << " pixel " << i;
  }
}

std::string refusal(const std::string& path) {
  return failure_text([&] { const PictureStack stack(path); });
}

class Pictures : public ::testing::Test {
 protected:
  ScratchDirectory folder_;
};

TEST_F(Pictures, NpyOfAllTypes) {
  const std::string stack = "(3, 5, 21)";
  const auto u16 = numbered<std::uint16_t>(3 * kPicturePixels, 207.0);
  write_npy(folder_ / "a.npy", "'<u2'", stack, u16);
  expect_frames(folder_ / "a.npy", ElementType::kU16, u16);
  write_npy(folder_ / "b.npy", "'|u1'", "(5, 21)", numbered<std::uint8_t>(kPicturePixels, 2.0));
  expect_frames(folder_ / "b.npy", ElementType::kU8, numbered<std::uint8_t>(kPicturePixels, 2.0));
  write_npy(folder_ / "c.npy", "'<f4'", stack, numbered<float>(3 * kPicturePixels, -0.25));
  expect_frames(folder_ / "c.npy", ElementType::kF32, numbered<float>(3 * kPicturePixels, -0.25));
  write_npy(folder_ / "d.npy", "'<f8'", stack, numbered<double>(3 * kPicturePixels, 1e-3));
  expect_frames(folder_ / "d.npy", ElementType::kF64, numbered<double>(3 * kPicturePixels, 1e-3));
  write_npy(folder_ / "e.npy", "'<i4'", stack, numbered<std::int32_t>(3 * kPicturePixels, -7e5));
  expect_frames(folder_ / "e.npy", ElementType::kI32,
                numbered<std::int32_t>(3 * kPicturePixels, -7e5));
  auto swapped = u16;
  for (auto& v : swapped) v = static_cast<std::uint16_t>(v << 8U | v >> 8U);
  write_npy(folder_ / "f.npy", "'>u2'", stack, swapped);
  expect_frames(folder_ / "f.npy", ElementType::kU16, u16);
}

TEST_F(Pictures, NpyThatIsNoFrameIsRefused) {
  const auto u16 = numbered<std::uint16_t>(kPicturePixels, 1.0);
  const auto refused = [&](const std::string& descr, const std::string& shape,
                           const std::string& fortran = "False") {
    write_npy(folder_ / "x.npy", descr, shape, u16, fortran);
    return refusal(folder_ / "x.npy");
  };
  EXPECT_EQ(refused("'<u2'", "(5, 21)"), "");
  EXPECT_NE(refused("'<u2'", "(5, 21)", "True").find("ascontiguousarray"), std::string::npos);
  EXPECT_NE(refused("'<i8'", "(5, 21)").find("astype"), std::string::npos);
  EXPECT_NE(refused("[('x', '<u2')]", "(5, 21)").find("record"), std::string::npos);
  EXPECT_NE(refused("'<\n\x1b[2J'", "(5, 21)").find("<\\x0a\\x1b[2J,"), std::string::npos);
  EXPECT_NE(refused("'<u2'", "(105,)").find("1 dimensions"), std::string::npos);
  EXPECT_NE(refused("'<u2'", "(1, 1, 5, 21)").find("4 dimensions"), std::string::npos);
  EXPECT_NE(refused("'<u2'", "(3, 5, 21)").find("promises 3 frames and holds 1"),
            std::string::npos);
  EXPECT_NE(refused("'<u2'", "(0, 5, 21)").find("promises 0"), std::string::npos);
  EXPECT_NE(refused("'<u2'", "(99999999999, 99999999999)").find("no detector"), std::string::npos);
  EXPECT_NE(refused("'<u2'", "(5, -21)").find("damaged"), std::string::npos);
}

TEST_F(Pictures, PngOf8And16Bits) {
  const auto u8 = numbered<std::uint8_t>(kPicturePixels, 2.0);
  write_png_8(folder_ / "a.png", kPictureRows, kPictureCols, u8);
  expect_frames(folder_ / "a.png", ElementType::kU8, u8);
  const auto u16 = numbered<std::uint16_t>(kPicturePixels, 607.0);
  write_png_16(folder_ / "b.png", kPictureRows, kPictureCols, u16);
  expect_frames(folder_ / "b.png", ElementType::kU16, u16);
}

TEST_F(Pictures, TiffInItsManyForms) {
  const auto u16 = numbered<std::uint16_t>(3 * kPicturePixels, 207.0);
  for (const std::string mode : {"w", "wb", "w8"}) {
    for (const int compression : {COMPRESSION_NONE, COMPRESSION_LZW, COMPRESSION_ADOBE_DEFLATE}) {
      for (const bool tiled : {false, true}) {
        write_tiff(
            folder_ / "a.tif", kPictureRows, kPictureCols, u16,
            {.mode = mode, .compression = static_cast<std::uint16_t>(compression), .tiled = tiled});
        expect_frames(folder_ / "a.tif", ElementType::kU16, u16);
      }
    }
  }
  const auto u8 = numbered<std::uint8_t>(2 * kPicturePixels, 1.0);
  write_tiff(folder_ / "b.tif", kPictureRows, kPictureCols, u8, {.bits = 8, .rows_of_strip = 100});
  expect_frames(folder_ / "b.tif", ElementType::kU8, u8);
  const auto f32 = numbered<float>(kPicturePixels, 0.125);
  write_tiff(folder_ / "c.tif", kPictureRows, kPictureCols, f32,
             {.bits = 32, .kind = SAMPLEFORMAT_IEEEFP});
  expect_frames(folder_ / "c.tif", ElementType::kF32, f32);
}

TEST_F(Pictures, ColoursPalettesAndOddTypesAreRefusedWithTheRemedy) {
  const std::vector<std::uint8_t> rgb(3 * kPicturePixels, 7);
  write_png_8(folder_ / "rgb.png", kPictureRows, kPictureCols, rgb, PNG_FORMAT_RGB);
  EXPECT_NE(refusal(folder_ / "rgb.png").find("has colours, and frames are grey: save it"),
            std::string::npos);
  write_png_8(folder_ / "ga.png", kPictureRows, kPictureCols, rgb, PNG_FORMAT_GA);
  EXPECT_NE(refusal(folder_ / "ga.png").find("transparency"), std::string::npos);
  write_png_grey(folder_ / "4.png", kPictureRows, kPictureCols, 4,
                 {kPictureRows, std::vector<std::uint8_t>(11, 5)});
  EXPECT_NE(refusal(folder_ / "4.png").find("4 bits"), std::string::npos);
  const std::vector<std::uint8_t> grey(kPicturePixels, 7);
  write_tiff(folder_ / "rgb.tif", kPictureRows, kPictureCols, rgb,
             {.bits = 8, .samples = 3, .photometric = PHOTOMETRIC_RGB});
  EXPECT_NE(refusal(folder_ / "rgb.tif").find("colours"), std::string::npos);
  write_tiff(folder_ / "palette.tif", kPictureRows, kPictureCols, grey,
             {.bits = 8, .photometric = PHOTOMETRIC_PALETTE});
  EXPECT_NE(refusal(folder_ / "palette.tif").find("palette"), std::string::npos);
  write_tiff(folder_ / "white.tif", kPictureRows, kPictureCols, grey,
             {.bits = 8, .photometric = PHOTOMETRIC_MINISWHITE});
  EXPECT_NE(refusal(folder_ / "white.tif").find("negative"), std::string::npos);
  write_tiff(folder_ / "12.tif", kPictureRows, kPictureCols,
             numbered<std::uint16_t>(kPicturePixels, 1.0), {.bits = 12});
  EXPECT_NE(refusal(folder_ / "12.tif").find("12 bits"), std::string::npos);
  write_tiff(folder_ / "ij.tif", kPictureRows, kPictureCols, grey,
             {.bits = 8, .description = "ImageJ=1.54\nimages=5000\n"});
  EXPECT_NE(refusal(folder_ / "ij.tif").find("ImageJ"), std::string::npos);
  write_bytes(folder_ / "a.jpg", "\xff\xd8\xff\xe0 and so on");
  EXPECT_NE(failure_text([&] { means_pictures(folder_ / "a.jpg"); }).find("JPEG"),
            std::string::npos);
}

TEST_F(Pictures, ASequenceIsInTheOrderOfItsNumbers) {
  EXPECT_TRUE(comes_before("run_2.png", "run_10.png"));
  EXPECT_FALSE(comes_before("run_10.png", "run_2.png"));
  EXPECT_TRUE(comes_before("a1_9", "a2_1"));
  EXPECT_TRUE(comes_before("a01", "a1"));
  EXPECT_FALSE(comes_before("a1", "a1"));
  for (const int n : {10, 2, 1})
    write_png_8(folder_ / ("f_" + std::to_string(n) + ".png"), kPictureRows, kPictureCols,
                std::vector<std::uint8_t>(kPicturePixels, static_cast<std::uint8_t>(n)));
  write_bytes(folder_ / "notes.txt", "no picture");
  for (const std::string& path : {folder_.path(), folder_ / "f_*.png"}) {
    ASSERT_TRUE(means_pictures(path));
    FitsSource source({path});
    EXPECT_EQ(source.frame_count(), 3);
    EXPECT_EQ(source.format().pixel_type, PixelType::kU8);
    FrameBuffer frame(source.format());
    for (const int n : {1, 2, 10}) {
      ASSERT_EQ(source.next(frame), Delivery::kFrame);
      EXPECT_EQ(static_cast<int>(frame.view().data<std::uint8_t>()[3]), n);
    }
    EXPECT_EQ(source.next(frame), Delivery::kEnd);
    EXPECT_EQ(read_truth(path), std::nullopt);
  }
  EXPECT_TRUE(FitsSource({folder_ / "f_1.png", folder_ / "f_2.png"}).notes().empty());
  EXPECT_FALSE(FitsSource({folder_ / "f_10.png", folder_ / "f_2.png"}).notes().empty());
  write_png_8(folder_ / "f_3.png", 4, 4, std::vector<std::uint8_t>(16, 1));
  EXPECT_NE(refusal(folder_.path()).find("f_3.png has frames: 1 of 4 x 4 pixels of 8 bits"),
            std::string::npos)
      << refusal(folder_.path());
  const ScratchDirectory nothing;
  EXPECT_NE(refusal(nothing.path()).find("without PNG"), std::string::npos);
  EXPECT_NE(refusal(nothing / "*.png").find("no file"), std::string::npos);
}

TEST_F(Pictures, PartsAndMeansAreThoseOfTheFrames) {
  const auto u16 = numbered<std::uint16_t>(2 * kPicturePixels, 300.0);
  write_tiff(folder_ / "a.tif", kPictureRows, kPictureCols, u16, {});
  FitsSource source({folder_ / "a.tif"}, {.region = PixelRegion{2, 1, 3, 2}});
  FrameBuffer frame(source.format());
  ASSERT_EQ(source.next(frame), Delivery::kFrame);
  const auto* pixels = frame.view().data<std::uint16_t>();
  for (int r = 0; r < 2; ++r)
    for (int c = 0; c < 3; ++c)
      EXPECT_EQ(pixels[r * 3 + c], u16[static_cast<std::size_t>((r + 1) * kPictureCols + c + 2)]);
  const MeanImage mean = read_mean_image(folder_ / "a.tif");
  EXPECT_EQ(mean.frames, 2);
  EXPECT_DOUBLE_EQ(mean.mean[4], 0.5 * (u16[4] + u16[kPicturePixels + 4]));
  EXPECT_THROW(FitsSource({folder_ / "a.tif"}, {.hdu = "2"}), UsageError);
}

TEST_F(Pictures, DamagedFilesAreRefusedAndDoNoHarm) {
  const auto u16 = numbered<std::uint16_t>(2 * kPicturePixels, 207.0);
  write_tiff(folder_ / "a.tif", kPictureRows, kPictureCols, u16, {.compression = COMPRESSION_LZW});
  write_tiff(folder_ / "b.tif", kPictureRows, kPictureCols, u16, {.tiled = true});
  write_png_16(folder_ / "a.png", kPictureRows, kPictureCols,
               {u16.begin(), u16.begin() + kPicturePixels});
  write_npy(folder_ / "a.npy", "'<u2'", "(2, 5, 21)", u16);
  std::mt19937 random(1);
  int refused = 0;
  for (const std::string name : {"a.tif", "b.tif", "a.png", "a.npy"}) {
    const std::string whole = read_bytes(folder_ / name);
    for (int trial = 0; trial < 400; ++trial) {
      std::string bytes = whole;
      if (trial % 4 == 0) bytes.resize(random() % bytes.size());
      for (int i = 0; i < 3 && !bytes.empty(); ++i)
        bytes[random() % bytes.size()] = static_cast<char>(random());
      write_bytes(folder_ / "damaged", bytes);
      const std::string said = failure_text([&] {
        PictureStack stack(folder_ / "damaged");
        std::vector<double> frame(stack.format().pixels());
        for (std::int64_t n = 0; n < std::min<std::int64_t>(stack.format().frames, 3); ++n)
          stack.read(n, {0, 0, stack.format().cols, stack.format().rows}, std::span(frame));
      });
      refused += said.empty() ? 0 : 1;
      EXPECT_TRUE(said.empty() || said.find("damaged") != std::string::npos);
    }
  }
  EXPECT_GT(refused, 400);  // every fourth is cut off
}

TEST_F(Pictures, AWrittenPngIsReadBack) {
  Image<Rgb> picture(2, 3);
  for (std::size_t i = 0; i < picture.size(); ++i)
    picture[i] = {static_cast<std::uint8_t>(10 * i), 200, static_cast<std::uint8_t>(i)};
  write_png(folder_ / "p.png", picture);
  EXPECT_EQ(folder_.names(), std::vector<std::string>{"p.png"});
  png_image read{};
  read.version = PNG_IMAGE_VERSION;
  ASSERT_NE(png_image_begin_read_from_file(&read, (folder_ / "p.png").c_str()), 0);
  EXPECT_EQ(read.width, 3U);
  EXPECT_EQ(read.height, 2U);
  read.format = PNG_FORMAT_RGB;
  std::vector<std::uint8_t> bytes(18);
  ASSERT_NE(png_image_finish_read(&read, nullptr, bytes.data(), 0, nullptr), 0);
  EXPECT_EQ(std::memcmp(bytes.data(), picture.data(), bytes.size()), 0);
  EXPECT_NE(failure_text([&] { write_png(folder_ / "no/p.png", picture); }).find("p.png"),
            std::string::npos);
}

}  // namespace
}  // namespace curlew
