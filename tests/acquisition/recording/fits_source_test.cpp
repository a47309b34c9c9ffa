#include "acquisition/recording/fits_source.h"

#include <gtest/gtest.h>

#include <array>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "acquisition/fits/fits_file.h"
#include "acquisition/recording/mean_image.h"
#include "tests/support/astropy_peer.h"
#include "tests/support/constants.h"
#include "tests/support/failure_text.h"
#include "tests/support/paths.h"
#include "tests/support/raw_fits.h"
#include "tests/support/scratch_directory.h"
#include "tests/support/text.h"

namespace curlew {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

template <typename T>
void write_cube(const std::string& path, ElementType element,
                const std::vector<std::int64_t>& shape, const std::vector<T>& pixels) {
  FitsFile file = FitsFile::create(path);
  file.create_image(element, shape);
  if (!pixels.empty()) file.write_pixels(0, std::span<const T>(pixels));
  file.commit();
}

void write_doubles(const std::string& path, const std::vector<std::int64_t>& shape,
                   const std::vector<double>& pixels) {
  write_cube(path, ElementType::kF64, shape, pixels);
}

// Returns all frames in physical ADU, one after the other.
std::vector<double> replay_adu(FitsSource& source) {
  FrameBuffer buffer(source.format());
  const FrameFormat& format = source.format();
  std::vector<double> values;
  while (source.next(buffer) == Delivery::kFrame) {
    EXPECT_EQ(buffer.rows_ready.load(), format.rows);
    const FrameView view = buffer.view();
    for (std::size_t k = 0; k < format.pixels(); ++k) {
      const double count = format.pixel_type == PixelType::kU8 ? view.data<std::uint8_t>()[k]
                                                               : view.data<std::uint16_t>()[k];
      values.push_back(format.zero_adu + format.scale_adu * count);
    }
  }
  return values;
}

TEST(FitsSource, UnsignedPixelsPassUntouched) {
  const ScratchDirectory scratch;
  write_cube<std::uint8_t>(scratch / "u8.fits", ElementType::kU8, {1, 2, 3}, {0, 1, 2, 3, 4, 255});
  write_cube<std::uint16_t>(scratch / "u16.fits", ElementType::kU16, {2, 2},
                            {0, 32767, 32768, 65535});
  FitsSource u8({scratch / "u8.fits"});
  EXPECT_EQ(u8.format().pixel_type, PixelType::kU8);
  EXPECT_EQ(u8.format().rows, 2);
  EXPECT_EQ(u8.format().cols, 3);
  FitsSource u16({scratch / "u16.fits"});
  EXPECT_EQ(u16.format().pixel_type, PixelType::kU16);
  EXPECT_EQ(u16.frame_count(), 1);
  for (FitsSource* source : {&u8, &u16}) {
    EXPECT_EQ(source->format().scale_adu, 1.0);
    EXPECT_EQ(source->format().zero_adu, 0.0);
    EXPECT_EQ(source->map_report(), "");
    EXPECT_TRUE(source->nan_pixels().empty());
  }
  EXPECT_EQ(replay_adu(u8), (std::vector<double>{0, 1, 2, 3, 4, 255}));
  EXPECT_EQ(replay_adu(u16), (std::vector<double>{0, 32767, 32768, 65535}));
}

TEST(FitsSource, SignedPixelsAreShiftedExactly) {
  const ScratchDirectory scratch;
  write_cube<std::int16_t>(scratch / "i16.fits", ElementType::kI16, {2, 2}, {-32768, -1, 0, 32767});
  FitsSource source({scratch / "i16.fits"});
  EXPECT_EQ(source.format().scale_adu, 1.0);
  EXPECT_EQ(source.format().zero_adu, -32768.0);
  EXPECT_TRUE(contains(source.map_report(), "32768"));
  EXPECT_EQ(replay_adu(source), (std::vector<double>{-32768, -1, 0, 32767}));
}

TEST(FitsSource, TheMapHasScaleOneWhereverTheRangeAllows) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "f.fits";
  const auto scale_of = [&](double a, double b) {
    write_doubles(path, {1, 2}, {a, b});
    FitsSource source({path});
    const std::vector<double> values = replay_adu(source);
    // Rounding to a count is off by half a count at most.
    EXPECT_NEAR(values[0], a, 0.5001 * source.format().scale_adu);
    EXPECT_NEAR(values[1], b, 0.5001 * source.format().scale_adu);
    EXPECT_FALSE(source.map_report().empty());
    return source.format().scale_adu;
  };
  EXPECT_EQ(scale_of(-10, 65525), 1.0);   // These are whole numbers that just fit.
  EXPECT_EQ(scale_of(3, 4), 1.0);         // These are whole numbers.
  EXPECT_EQ(scale_of(0.5, 4096.5), 1.0);  // The span is wide enough to round.
  EXPECT_DOUBLE_EQ(scale_of(0.5, 4096.4), 4095.9 / 65535);  // The span is not wide enough.
  EXPECT_DOUBLE_EQ(scale_of(-10, 65526), 65536.0 / 65535);
  EXPECT_DOUBLE_EQ(scale_of(-1e200, 1e200), 2e200 / 65535);
  EXPECT_EQ(scale_of(7.25, 7.25), 1.0);  // The values are constant.
  EXPECT_EQ(scale_of(0, 5e-324), 1.0);   // They are as good as constant.
  EXPECT_DOUBLE_EQ(scale_of(0.1, 0.2), 0.1 / 65535);
}

TEST(FitsSource, OneMapServesAllFilesAndNanPixelsAreTheirUnion) {
  const ScratchDirectory scratch;
  write_doubles(scratch / "a.fits", {2, 1, 4}, {kNaN, 100, 200, 300, 5, 6, 7, 8});
  write_doubles(scratch / "b.fits", {1, 4}, {-50, kInfinity, 0, 60000});
  FitsSource source({scratch / "a.fits", scratch / "b.fits"});
  EXPECT_EQ(source.frame_count(), 3);
  EXPECT_EQ(source.format().scale_adu, 1.0);
  EXPECT_EQ(source.format().zero_adu, -50.0);
  const Image<std::uint8_t>& bad = source.nan_pixels();
  EXPECT_EQ(std::vector<int>(bad.begin(), bad.end()), (std::vector<int>{1, 1, 0, 0}));
  EXPECT_TRUE(contains(source.map_report(), "2 pixels")) << source.map_report();
  // Bad pixels get count 0, the map's minimum.
  EXPECT_EQ(replay_adu(source),
            (std::vector<double>{-50, 100, 200, 300, 5, 6, 7, 8, -50, -50, 0, 60000}));
}

TEST(FitsSource, AFrameWithoutAnyValueIsIncompleteAndSpoilsNoPixel) {
  const ScratchDirectory scratch;
  write_doubles(scratch / "a.fits", {3, 1, 2}, {1, 2, kNaN, kNaN, 3, 4});
  FitsSource source({scratch / "a.fits"});
  EXPECT_TRUE(source.nan_pixels().empty());
  FrameBuffer buffer(source.format());
  std::vector<std::uint32_t> status;
  while (source.next(buffer) == Delivery::kFrame) status.push_back(buffer.header.status);
  EXPECT_EQ(status, (std::vector<std::uint32_t>{kFrameOk, kFrameIncomplete, kFrameOk}));
}

TEST(FitsSource, APixelThatIsFlaggedInAllFramesIsBadAndOthersAreClipped) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "a.fits";
  std::vector<double> pixels;
  for (int n = 0; n < 3; ++n)
    for (int k = 0; k < 400; ++k) pixels.push_back(0.001 * ((k * 37 + n * 11) % 100));
  for (const std::size_t n : {0U, 1U, 2U}) pixels[n * 400 + 7] = -1e30;
  pixels[400 + 9] = 1e38;
  write_doubles(path, {3, 20, 20}, pixels);
  FitsSource source({path});
  EXPECT_TRUE(contains(source.map_report(), "1 pixel that is far outside this range in all frames"))
      << source.map_report();
  EXPECT_TRUE(contains(source.map_report(), "1 value far outside")) << source.map_report();
  ASSERT_EQ(source.nan_pixels().size(), 400U);
  for (std::size_t k = 0; k < 400; ++k) EXPECT_EQ(source.nan_pixels()[k], k == 7 ? 1 : 0);
  const std::vector<double> values = replay_adu(source);
  ASSERT_EQ(values.size(), pixels.size());
  for (std::size_t k = 0; k < values.size(); ++k) {
    // All others keep their value to half a step of a 65535th of their range, and what is clipped
    // becomes the largest of them.
    const double expected = k % 400 == 7 ? 0.0 : k == 409 ? 0.099 : pixels[k];
    ASSERT_NEAR(values[k], expected, 1e-6) << k;
  }
  const MeanImage mean = read_mean_image(path);
  EXPECT_TRUE(std::isnan(mean.mean[7]));
  EXPECT_NEAR(mean.mean[9], (pixels[9] + 0.099 + pixels[809]) / 3.0, 1e-12);
  EXPECT_NEAR(mean.mean[8], (pixels[8] + pixels[408] + pixels[808]) / 3.0, 1e-12);
}

// Draws unsigned pixels: a background of 900 with some noise, and in a quarter of the pixels light
// of up to `top`, of many values.
std::vector<std::uint16_t> draw_unsigned(int top) {
  std::vector<std::uint16_t> pixels;
  for (int k = 0; k < 1600; ++k) {
    const int light = k % 40 < 10 ? k * 977 % top : 0;
    pixels.push_back(static_cast<std::uint16_t>(900 + k * 37 % 20 + light));
  }
  return pixels;
}

TEST(FitsSource, UnsignedPixelsThatLostTheirZeroAreReadAsUnsigned) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "a.fits";
  for (const int shift : {32768, 65536}) {
    const std::vector<std::uint16_t> truth = draw_unsigned(shift == 32768 ? 5000 : 60000);
    std::vector<std::int16_t> pixels;
    std::vector<double> expected;
    for (const std::uint16_t pixel : truth) {
      const bool moved = shift == 32768 || pixel > 32767;
      pixels.push_back(static_cast<std::int16_t>(moved ? pixel - shift : pixel));
      expected.push_back(pixel);
    }
    write_cube(path, ElementType::kI16, {40, 40}, pixels);
    FitsSource source({path});
    ASSERT_EQ(source.notes().size(), 1U);
    EXPECT_TRUE(contains(source.notes()[0], "BZERO")) << source.notes()[0];
    EXPECT_TRUE(contains(source.notes()[0], std::to_string(shift))) << source.notes()[0];
    EXPECT_EQ(replay_adu(source), expected);
    EXPECT_EQ(read_mean_image(path).mean[3], expected[3]);
  }
}

TEST(FitsSource, SignedPixelsThatAreSignedStayWhatTheyAre) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "a.fits";
  std::vector<std::int16_t> pixels;
  for (const std::uint16_t pixel : draw_unsigned(30000))
    pixels.push_back(static_cast<std::int16_t>(pixel - 905));
  for (std::size_t k = 0; k < 40; ++k) pixels[40 * k] = -5000;  // This is what overscan holds.
  pixels[41] = -32768;                                          // This is a flag.
  write_cube(path, ElementType::kI16, {40, 40}, pixels);
  FitsSource source({path});
  EXPECT_TRUE(source.notes().empty());
  EXPECT_EQ(replay_adu(source), std::vector<double>(pixels.begin(), pixels.end()));
}

void write_frame_table(FitsFile& file, const std::vector<std::int64_t>& sequence) {
  file.create_table("FRAMES",
                    std::array<ColumnSpec, 2>{{{"STATUS", 'J', ""}, {"SEQUENCE", 'K', ""}}});
  const std::vector<std::int32_t> status(sequence.size(), 8);
  file.write_column("STATUS", 0, std::span<const std::int32_t>(status));
  file.write_column("SEQUENCE", 0, std::span<const std::int64_t>(sequence));
}

TEST(FitsSource, AShortOrMissingFrameTableStillReplays) {
  const ScratchDirectory scratch;
  for (const std::string name : {"short.fits", "plain.fits"}) {
    FitsFile file = FitsFile::create(scratch / name);
    file.create_image(ElementType::kU8, {4, 2, 2});
    if (name == "short.fits") write_frame_table(file, {100, 103});
    file.commit();
  }
  FitsSource source({scratch / "plain.fits", scratch / "short.fits", scratch / "plain.fits"});
  FrameBuffer buffer(source.format());
  std::vector<std::int64_t> sequence;
  std::vector<std::uint32_t> status;
  const auto start = std::chrono::steady_clock::now();
  while (source.next(buffer) == Delivery::kFrame) {
    sequence.push_back(buffer.header.sequence);
    status.push_back(buffer.header.status);
    EXPECT_EQ(buffer.header.camera_ns, 0);
    EXPECT_GE(buffer.header.received, start);
    EXPECT_LE(buffer.header.received, std::chrono::steady_clock::now());
  }
  EXPECT_EQ(sequence,
            (std::vector<std::int64_t>{0, 1, 2, 3, 100, 103, 104, 105, 106, 107, 108, 109}));
  EXPECT_EQ(status, (std::vector<std::uint32_t>{0, 0, 0, 0, 8, 8, 0, 0, 0, 0, 0, 0}));
  EXPECT_EQ(source.next(buffer), Delivery::kEnd);  // It must stay at the end.
}

TEST(FitsSource, SequencesEndWithoutOverflow) {
  const ScratchDirectory scratch;
  constexpr auto kLast = std::numeric_limits<std::int64_t>::max();
  FitsFile file = FitsFile::create(scratch / "end.fits");
  file.create_image(ElementType::kU8, {3, 2, 2});
  write_frame_table(file, {kLast});
  file.commit();
  FitsSource source({scratch / "end.fits"});
  FrameBuffer buffer(source.format());
  for (const std::int64_t sequence : {kLast, std::int64_t{0}, std::int64_t{1}}) {
    ASSERT_EQ(source.next(buffer), Delivery::kFrame);
    EXPECT_EQ(buffer.header.sequence, sequence);
  }
}

TEST(FitsSource, AFrameTableThatWasCutOffStillReplays) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "cut.fits";
  FitsFile file = FitsFile::create(path);
  file.create_image(ElementType::kU8, {1000, 2, 2});
  std::vector<std::int64_t> sequence(1000);
  for (std::size_t i = 0; i < sequence.size(); ++i) sequence[i] = 7 + static_cast<std::int64_t>(i);
  write_frame_table(file, sequence);
  file.commit();
  // The file has a header, 4000 bytes of pixels in two blocks, a table header, and 12 bytes per
  // row.
  const std::uintmax_t table = 2880 + 2 * 2880;
  for (const std::uintmax_t size : {table + 2880 + 12 * 500 + 5, table + 1000, table}) {
    std::filesystem::resize_file(path, size);
    FitsSource source({path});
    FrameBuffer buffer(source.format());
    int frames = 0;
    while (source.next(buffer) == Delivery::kFrame) ++frames;
    EXPECT_EQ(frames, 1000);
    EXPECT_EQ(buffer.header.sequence, size > table + 2880 ? 1006 : 999) << size;
  }
}

TEST(FitsSource, HeaderKeysBecomeOpticsDetectorAndRegion) {
  const ScratchDirectory scratch;
  FitsFile file = FitsFile::create(scratch / "a.fits");
  file.create_image(ElementType::kU8, {2, 2});
  file.write_key("PITCH_M", 1.5e-4);
  file.write_key("PARITY", std::int64_t{-1});
  file.write_key("EPERADU", 2.5);
  file.write_key("BITDEPTH", std::int64_t{12});
  file.write_key("OFFSETX", std::int64_t{64});
  file.write_key("XBINNING", std::int64_t{2});
  file.write_key("YBINNING", std::int64_t{2});
  file.commit();
  const FitsSource source({scratch / "a.fits"});
  EXPECT_EQ(source.optics().pitch_m, 1.5e-4);
  EXPECT_TRUE(std::isnan(source.optics().focal_m));
  EXPECT_EQ(source.optics().magnification, 1.0);
  EXPECT_TRUE(source.optics().mirrored);
  EXPECT_EQ(source.detector().e_per_adu, 2.5);
  EXPECT_TRUE(std::isnan(source.detector().saturation_adu));
  EXPECT_EQ(source.detector().bit_depth, 12);
  EXPECT_EQ(source.format().offset_x_px, 64);
  EXPECT_EQ(source.format().offset_y_px, 0);
  EXPECT_EQ(source.format().binning, 2);
}

TEST(FitsSource, KeysThatMakeNoSenseAreRefused) {
  const ScratchDirectory scratch;
  const std::vector<std::pair<std::string, KeyValue>> wrong{{"PITCH_M", -1.0},
                                                            {"FOCAL_M", 0.0},
                                                            {"WAVELEN", 1e9},
                                                            {"EPERADU", 0.0},
                                                            {"RDNOISE", -1.0},
                                                            {"SATURATE", 1e300},
                                                            {"PARITY", std::int64_t{3}},
                                                            {"BITDEPTH", std::int64_t{1} << 40U},
                                                            {"OFFSETX", std::int64_t{1} << 31U},
                                                            {"OFFSETY", -(std::int64_t{1} << 40U)},
                                                            {"XBINNING", std::int64_t{0}},
                                                            {"YBINNING", std::int64_t{2}}};
  for (const auto& [key, value] : wrong) {
    const std::string path = scratch / "a.fits";
    FitsFile file = FitsFile::create(path);
    file.create_image(ElementType::kU8, {2, 2});
    file.write_key(key, value);
    file.commit();
    const std::string text = failure_text([&] { FitsSource source({path}); });
    EXPECT_TRUE(contains(text, path) && contains(text, key)) << key << ": " << text;
  }
}

// What is read must fit the memory that was made for it.
TEST(FitsSource, FramesOfAnotherSizeThanAtFirstAreRefused) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "a.fits";
  write_cube<std::uint8_t>(path, ElementType::kU8, {2, 2}, {1, 2, 3, 4});
  FitsSource source({path});
  FrameBuffer small({.rows = 1, .cols = 2, .pixel_type = PixelType::kU8});
  EXPECT_TRUE(contains(failure_text([&] { source.next(small); }), "the buffer takes 2"));
  write_cube<std::uint8_t>(path, ElementType::kU8, {2000, 2000}, {});
  FrameBuffer buffer(source.format());
  EXPECT_TRUE(contains(failure_text([&] { source.next(buffer); }), "has changed"));
}

TEST(FitsSource, WhatCannotBeReplayedIsRefusedInOneSentence) {
  const ScratchDirectory scratch;
  const auto refusal = [&](const std::vector<std::string>& names) {
    std::vector<std::string> paths;
    for (const std::string& name : names) paths.push_back(scratch / name);
    const std::string text = failure_text([&] { FitsSource source(paths); });
    EXPECT_TRUE(contains(text, paths.back())) << text;
    EXPECT_FALSE(contains(text, "\n")) << text;
    return text;
  };
  write_cube<std::uint8_t>(scratch / "good.fits", ElementType::kU8, {2, 2}, {1, 2, 3, 4});
  write_cube<std::uint8_t>(scratch / "wide.fits", ElementType::kU8, {2, 3}, {});
  write_cube<std::uint16_t>(scratch / "u16.fits", ElementType::kU16, {2, 2}, {1, 2, 3, 4});
  write_cube<std::uint8_t>(scratch / "no_frames.fits", ElementType::kU8, {0, 2, 2}, {});
  write_cube<std::uint8_t>(scratch / "no_image.fits", ElementType::kU8, {}, {});
  write_cube<std::uint8_t>(scratch / "line.fits", ElementType::kU8, {5}, {});
  write_cube<std::uint8_t>(scratch / "four.fits", ElementType::kU8, {2, 2, 2, 2}, {});
  write_doubles(scratch / "real.fits", {2, 2}, {1, 2, 3, 4});
  write_doubles(scratch / "nan.fits", {2, 2}, {kNaN, kNaN, kInfinity, kNaN});
  write_doubles(scratch / "never.fits", {2, 1, 2}, {kNaN, 1, 1, kNaN});
  write_doubles(scratch / "far.fits", {1, 2}, {-1.7e308, 1.7e308});
  write_bytes(scratch / "empty.fits", "");
  write_bytes(scratch / "cut.fits", raw_image_header(8, {"8", "4", "10"}) + std::string(70, '\0'));
  write_bytes(scratch / "huge.fits",
              raw_image_header(8, {"3000000000", "3000000000", "3000000000"}));
  for (const std::string name : {"moved.fits", "oblong.fits", "odd.fits"}) {
    FitsFile file = FitsFile::create(scratch / name);
    file.create_image(ElementType::kU8, {2, 2});
    file.write_key("XBINNING", std::int64_t{2});
    file.write_key("YBINNING", std::int64_t{name == "oblong.fits" ? 1 : 2});
    if (name == "odd.fits") file.write_key("PARITY", std::int64_t{0});
    file.commit();
  }
  EXPECT_TRUE(contains(refusal({"missing.fits"}), "does not exist"));
  EXPECT_TRUE(contains(refusal({"empty.fits"}), "is empty"));
  EXPECT_TRUE(contains(refusal({"cut.fits"}), "2 whole ones are there"));
  EXPECT_TRUE(contains(refusal({"huge.fits"}), "more than any file can hold"));
  EXPECT_TRUE(contains(refusal({"no_frames.fits"}), "holds no frame"));
  EXPECT_TRUE(contains(refusal({"no_image.fits"}), "holds no image"));
  EXPECT_TRUE(contains(refusal({"line.fits"}), "one-dimensional"));
  EXPECT_TRUE(contains(refusal({"four.fits"}), "more than three dimensions"));
  EXPECT_TRUE(contains(refusal({"nan.fits"}), "no finite pixel"));
  EXPECT_TRUE(contains(refusal({"real.fits", "nan.fits"}), "no finite pixel"));
  EXPECT_TRUE(contains(refusal({"never.fits"}), "finite in all frames"));
  EXPECT_TRUE(contains(refusal({"far.fits"}), "too far apart"));
  EXPECT_TRUE(contains(refusal({"oblong.fits"}), "2 x 1"));
  EXPECT_TRUE(contains(refusal({"odd.fits"}), "PARITY"));
  const std::string size = refusal({"good.fits", "wide.fits"});
  EXPECT_TRUE(contains(size, "good.fits") && contains(size, "2 x 2") && contains(size, "2 x 3"))
      << size;
  const std::string type = refusal({"good.fits", "u16.fits"});
  EXPECT_TRUE(contains(type, "16-bit") && contains(type, "8-bit")) << type;
  EXPECT_TRUE(contains(refusal({"good.fits", "moved.fits"}), "binning 2"));
}

TEST(MeanImage, IsTheMeanAndTheScatterOverFrames) {
  const ScratchDirectory scratch;
  // With a bias this large a sum of squares would cancel.
  write_doubles(scratch / "a.fits", {3, 1, 3}, {1e9, 5, kNaN, 1e9 + 1, 5, 1, 1e9 + 2, 5, 1});
  const MeanImage stack = read_mean_image(scratch / "a.fits");
  EXPECT_EQ(stack.frames, 3);
  EXPECT_DOUBLE_EQ(stack.mean[0], 1e9 + 1);
  EXPECT_NEAR(stack.variance[0], 1.0, 1e-6);  // 1e9 in double leaves 1e-7.
  EXPECT_EQ(stack.mean[1], 5.0);
  EXPECT_EQ(stack.variance[1], 0.0);
  EXPECT_TRUE(std::isnan(stack.mean[2]));
  EXPECT_TRUE(std::isnan(stack.variance[2]));

  write_cube<std::uint16_t>(scratch / "b.fits", ElementType::kU16, {1, 2}, {40000, 7});
  const MeanImage single = read_mean_image(scratch / "b.fits");
  EXPECT_TRUE(single.variance.empty());
  EXPECT_EQ(single.mean[0], 40000.0);
  write_doubles(scratch / "nan.fits", {1, 2}, {kNaN, kNaN});
  EXPECT_TRUE(contains(failure_text([&] { read_mean_image(scratch / "nan.fits"); }), "nan.fits"));
}

TEST(FitsSource, RealFramesReplay) {
  const std::string path = std::string(kFramesDir) + "/mmirs_camera2_ref.fits";
  if (!std::filesystem::exists(path)) GTEST_SKIP() << "no real frames at " << kFramesDir;
  FitsSource source({path});
  const std::vector<double> values = replay_adu(source);
  const MeanImage mean = read_mean_image(path);
  ASSERT_EQ(values.size(), mean.mean.size());
  for (std::size_t k = 0; k < values.size(); ++k) {
    // Mapping may cost half a count.
    ASSERT_NEAR(values[k], mean.mean[k], 0.5001 * source.format().scale_adu) << k;
  }
}

// These tests read cubes that astropy wrote; tests/support/astropy_peer.py has the formulas.
class AstropyCubes : public testing::Test {
 protected:
  void SetUp() override {
    static const ScratchDirectory shared;  // astropy is slow and writes once for all tests.
    static const PeerAnswer answer = ask_astropy("write", shared.path());
    if (answer.exit_code == 77) GTEST_SKIP() << "astropy is not installed";
    ASSERT_EQ(answer.exit_code, 0) << answer.text;
    std::filesystem::copy(shared.path(), scratch_.path());
  }

  void expect_cube(const std::string& name, const std::function<double(int)>& value) {
    SCOPED_TRACE(name);
    FitsSource source({scratch_ / name});
    EXPECT_EQ(source.frame_count(), 3);
    EXPECT_EQ(source.format().rows, 5);
    EXPECT_EQ(source.format().cols, 7);
    const std::vector<double> values = replay_adu(source);
    ASSERT_EQ(values.size(), 105U);
    for (int i = 0; i < 105; ++i) {
      const double expected = value(i);
      if (!std::isfinite(expected)) continue;
      // Whole numbers are exact; others are off by half a count at most.
      const double tolerance =
          source.format().scale_adu == 1.0 && expected == std::round(expected)
              ? 0.5 * (source.format().zero_adu != std::round(source.format().zero_adu))
              : 0.5001 * source.format().scale_adu;
      ASSERT_NEAR(values[static_cast<std::size_t>(i)], expected, tolerance) << i;
    }
  }

  const ScratchDirectory scratch_;
};

TEST_F(AstropyCubes, ReplayWithTheirPhysicalValues) {
  const std::map<std::string, std::function<double(int)>> formulas{
      {"u8", [](int i) { return (i * 2) % 256; }},
      {"u16", [](int i) { return 65535 - i * 600; }},
      {"i16", [](int i) { return -32768 + i * 600; }},
      {"i32", [](int i) { return 100000 + i * 7; }},
      {"u32", [](int i) { return 4e9 + i * 1e6; }},
      {"i64", [](int i) { return 5e9 + i * 3; }},
      {"f32", [](int i) { return 0.25 * i - 3; }},
      {"f64", [](int i) { return i * 100.5; }},
  };
  for (const auto& [name, value] : formulas) {
    expect_cube(name + ".fits", value);
    expect_cube(name + "_extension.fits", value);
    if (name == "u8" || name == "u16" || name == "i16" || name == "i32") {
      expect_cube(name + "_compressed.fits", value);
    }
  }
  expect_cube("scaled.fits", [](int i) { return 100 + 0.5 * (-32768 + i * 600); });
  expect_cube("degenerate.fits", [](int i) { return (i * 2) % 256; });
  EXPECT_EQ(FitsSource({scratch_ / "single.fits"}).frame_count(), 1);
  for (const std::string name : {"u8", "u16"}) {
    EXPECT_EQ(FitsSource({scratch_ / (name + "_compressed.fits")}).map_report(), "") << name;
  }
}

TEST_F(AstropyCubes, NanInfinityAndBlankAreBadPixels) {
  for (const std::string name : {"holes.fits", "holes_compressed.fits"}) {
    expect_cube(name, [](int i) { return i == 35 + 17 || i == 70 ? kNaN : 0.25 * i - 3; });
    const FitsSource source({scratch_ / name});
    ASSERT_FALSE(source.nan_pixels().empty()) << name;
    for (int k = 0; k < 35; ++k) {
      EXPECT_EQ(source.nan_pixels()[static_cast<std::size_t>(k)], k == 17 || k == 0) << name << k;
    }
  }
  const FitsSource blank({scratch_ / "blank.fits"});
  ASSERT_FALSE(blank.nan_pixels().empty());
  EXPECT_EQ(blank.nan_pixels()[0], 1);
  EXPECT_EQ(blank.nan_pixels()[1], 0);
  EXPECT_EQ(blank.format().zero_adu, 100007.0);
}

TEST_F(AstropyCubes, ACutCompressedCubeIsTruncated) {
  const std::string path = scratch_ / "i32_compressed.fits";
  // This cuts off first the padding and then tiles.
  std::filesystem::resize_file(path, std::filesystem::file_size(path) - 2880);
  const std::string text = failure_text([&] { FitsSource source({path}); });
  EXPECT_TRUE(contains(text, path) && contains(text, "is truncated")) << text;
}

}  // namespace
}  // namespace curlew
