// These tests say which images of a file are its frames, and which part of them is read.
#include "acquisition/recording/frame_hdus.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <vector>

#include "acquisition/fits/fits_file.h"
#include "acquisition/recording/fits_source.h"
#include "acquisition/recording/mean_image.h"
#include "core/error.h"
#include "tests/support/failure_text.h"
#include "tests/support/scratch_directory.h"
#include "tests/support/text.h"

namespace curlew {
namespace {

/// Describes an image to be written. All its pixels are `value`.
struct TestImage {
  std::string name;
  std::vector<std::int64_t> shape;
  std::uint16_t value = 0;
};

class FrameImages : public testing::Test {
 protected:
  std::string path() const { return scratch_ / "f.fits"; }

  /// Writes the images into extensions; the primary has no pixels.
  void write(const std::vector<TestImage>& images) {
    FitsFile file = FitsFile::create(path());
    file.create_image(ElementType::kU8, {});
    for (const TestImage& image : images) {
      file.create_image(ElementType::kU16, image.shape, image.name);
      std::int64_t size = 1;
      for (const std::int64_t n : image.shape) size *= n;
      const std::vector<std::uint16_t> pixels(static_cast<std::size_t>(size), image.value);
      file.write_pixels(0, std::span<const std::uint16_t>(pixels));
    }
    file.commit();
  }

  /// Returns the first pixel of each frame that is read.
  std::vector<int> read(const FrameSelection& selection = {}) {
    FitsSource source({path()}, selection);
    notes_ = source.notes();
    FrameBuffer buffer(source.format());
    std::vector<int> first;
    while (source.next(buffer) == Delivery::kFrame)
      first.push_back(buffer.view().data<std::uint16_t>()[0]);
    EXPECT_EQ(static_cast<std::int64_t>(first.size()), source.frame_count());
    return first;
  }

  /// Returns the sentence with which the file is refused, which must list its images.
  std::string refusal(const FrameSelection& selection = {}) {
    const std::string text = failure_text([&] { FitsSource source({path()}, selection); });
    EXPECT_TRUE(contains(text, path())) << text;
    EXPECT_FALSE(contains(text, "\n")) << text;
    return text;
  }

  const ScratchDirectory scratch_;
  std::vector<std::string> notes_;
};

TEST_F(FrameImages, OneImageNeedsNoWord) {
  write({{"ANY", {2, 3, 4}, 7}});
  EXPECT_EQ(read(), (std::vector<int>{7, 7}));
  EXPECT_TRUE(notes_.empty());
}

TEST_F(FrameImages, AFrameAnExtensionIsReadInOrderAndSaid) {
  write({{"F0", {3, 4}, 5}, {"F1", {3, 4}, 6}, {"", {3, 4}, 8}});
  EXPECT_EQ(read(), (std::vector<int>{5, 6, 8}));
  ASSERT_EQ(notes_.size(), 1U);
  EXPECT_TRUE(contains(notes_[0], "3 image extensions")) << notes_[0];
  EXPECT_EQ(read_mean_image(path()).frames, 3);
  EXPECT_NEAR(read_mean_image(path()).mean[0], 19.0 / 3.0, 1e-12);
}

TEST_F(FrameImages, WhatANameSaysToBeSomethingElseIsLeftOut) {
  for (const std::string other : {"DARK", "dark", "MASTER_FLAT", "BADPIX", "MASK", "ERR", "DQ"}) {
    write({{other, {3, 4}, 1}, {"PIXELS", {2, 3, 4}, 9}});
    EXPECT_EQ(read(), (std::vector<int>{9, 9})) << other;
    ASSERT_EQ(notes_.size(), 1U);
    EXPECT_TRUE(contains(notes_[0], "2 PIXELS (2 x 3 x 4)")) << notes_[0];
    write({{other, {3, 4}, 1}, {"SCI", {3, 4}, 9}});
    EXPECT_EQ(read(), (std::vector<int>{9})) << other;
  }
  // A name that says frames is taken before one that says nothing.
  write({{"OTHER", {3, 4}, 1}, {"SCI", {3, 4}, 9}});
  EXPECT_EQ(read(), (std::vector<int>{9}));
  // Where there is nothing else, it is what is meant.
  write({{"DARK", {3, 4}, 1}});
  EXPECT_EQ(read(), (std::vector<int>{1}));
}

TEST_F(FrameImages, ADarkIsTakenFromWhereItsNameIs) {
  write({{"PIXELS", {2, 3, 4}, 9}, {"DARK", {3, 4}, 1}, {"FLAT", {3, 4}, 2}, {"BPM", {3, 4}, 3}});
  const auto mean = [&](ImageContent content) {
    return read_mean_image(path(), {.content = content}).mean[0];
  };
  EXPECT_EQ(mean(ImageContent::kFrames), 9.0);
  EXPECT_EQ(mean(ImageContent::kDark), 1.0);
  EXPECT_EQ(mean(ImageContent::kFlat), 2.0);
  EXPECT_EQ(mean(ImageContent::kBadPixels), 3.0);
}

TEST_F(FrameImages, TheOnlyCubeIsMeant) {
  write({{"A", {3, 4}, 1}, {"B", {2, 3, 4}, 2}, {"C", {5, 5}, 3}});
  EXPECT_EQ(read(), (std::vector<int>{2, 2}));
  EXPECT_EQ(notes_.size(), 1U);
}

TEST_F(FrameImages, WhatIsNotPlainIsRefusedWithAListOfTheImages) {
  const std::vector<std::vector<TestImage>> unclear{
      {{"A", {3, 4}, 1}, {"B", {5, 5}, 2}},
      {{"OPEN", {2, 3, 4}, 1}, {"CLOSED", {2, 3, 4}, 2}},
      {{"A", {3, 4}, 1}, {"B", {2, 3, 4}, 2}, {"C", {2, 5, 4}, 3}}};
  for (const auto& images : unclear) {
    write(images);
    const std::string text = refusal();
    for (const TestImage& image : images) EXPECT_TRUE(contains(text, image.name)) << text;
    EXPECT_TRUE(contains(text, "--hdu")) << text;
  }
}

TEST_F(FrameImages, DetectorsSideBySideAreNotFramesOneAfterTheOther) {
  FitsFile file = FitsFile::create(path());
  for (const std::string section : {"[1:4,1:3]", "[5:8,1:3]"}) {
    file.create_image(ElementType::kU16, {3, 4});
    file.write_key("DETSEC", section);
  }
  file.commit();
  EXPECT_TRUE(contains(refusal(), "--hdu"));
  EXPECT_EQ(read({.hdu = "1"}).size(), 1U);
}

TEST_F(FrameImages, TheUserNamesAnImageByNameOrNumber) {
  write({{"A", {3, 4}, 1}, {"B", {5, 5}, 2}, {"A", {3, 4}, 3}});
  EXPECT_EQ(read({.hdu = "b"}), (std::vector<int>{2}));
  EXPECT_EQ(read({.hdu = "1"}), (std::vector<int>{1}));
  EXPECT_EQ(read({.hdu = "3"}), (std::vector<int>{3}));
  EXPECT_TRUE(notes_.empty());
  EXPECT_EQ(read({.hdu = "A"}), (std::vector<int>{1, 3})) << "both images have this name";
  for (const std::string hdu : {"0", "4", "-1", "C"}) {
    const std::string text = refusal({.hdu = hdu});
    EXPECT_TRUE(contains(text, "no image HDU " + hdu) && contains(text, "2 B (5 x 5)")) << text;
  }
}

TEST_F(FrameImages, ARecordingThatWasCutOffBehindItsFramesStillReplays) {
  FitsFile file = FitsFile::create(path());
  file.create_image(ElementType::kU16, {2, 3, 4});
  file.create_image(ElementType::kU8, {100000}, "UNFINISHED");
  file.commit();
  EXPECT_EQ(read().size(), 2U);
  EXPECT_TRUE(notes_.empty());
  std::filesystem::resize_file(path(), 3 * 2880);
  EXPECT_EQ(read().size(), 2U);
}

// Pixel (x, y) of frame n has the value 100 n + 10 y + x.
class FrameRegions : public FrameImages {
 protected:
  void write_region_cube(const std::string& data_section, ElementType element) {
    FitsFile file = FitsFile::create(path());
    file.create_image(element, {2, 4, 6});
    std::vector<std::uint16_t> pixels;
    for (int n = 0; n < 2; ++n)
      for (int y = 0; y < 4; ++y)
        for (int x = 0; x < 6; ++x)
          pixels.push_back(static_cast<std::uint16_t>(100 * n + 10 * y + x));
    file.write_pixels(0, std::span<const std::uint16_t>(pixels));
    if (!data_section.empty()) file.write_key("DATASEC", data_section);
    file.write_key("OFFSETX", std::int64_t{64});
    file.commit();
  }

  void expect_region(const PixelRegion& region, const FrameSelection& selection) {
    FitsSource source({path()}, selection);
    notes_ = source.notes();
    const FrameFormat& format = source.format();
    EXPECT_EQ(format.rows, region.height);
    EXPECT_EQ(format.cols, region.width);
    EXPECT_EQ(format.offset_x_px, 64 + region.x);
    EXPECT_EQ(format.offset_y_px, region.y);
    FrameBuffer buffer(format);
    for (int n = 0; n < 2; ++n) {
      ASSERT_EQ(source.next(buffer), Delivery::kFrame);
      for (std::size_t k = 0; k < format.pixels(); ++k) {
        const int count = format.pixel_type == PixelType::kU8
                              ? buffer.view().data<std::uint8_t>()[k]
                              : buffer.view().data<std::uint16_t>()[k];
        const int row = static_cast<int>(k) / format.cols;
        const int col = static_cast<int>(k) % format.cols;
        ASSERT_EQ(format.zero_adu + format.scale_adu * count,
                  100 * n + 10 * (region.y + row) + region.x + col);
      }
    }
  }
};

TEST_F(FrameRegions, DatasecIsReadWhereItIsAndTheUsersRegionBeforeIt) {
  for (const ElementType element :
       {ElementType::kU8, ElementType::kI16, ElementType::kU16, ElementType::kI32}) {
    write_region_cube("[3:6,2:4]", element);
    expect_region({2, 1, 4, 3}, {});
    ASSERT_EQ(notes_.size(), 1U);
    EXPECT_TRUE(contains(notes_[0], "columns 2 to 5 and rows 1 to 3")) << notes_[0];
    expect_region({0, 0, 6, 4}, {.region = PixelRegion{0, 0, 6, 4}});
    expect_region({1, 0, 5, 2}, {.region = PixelRegion{1, 0, 5, 2}});
    EXPECT_TRUE(notes_.empty());
  }
  EXPECT_EQ(read_mean_image(path()).mean[0], 62.0);  // The mean of 12 and 112.
}

TEST_F(FrameRegions, ADatasecThatIsAllOrNoPartOfTheImageLeavesAll) {
  write_region_cube("[1:6,1:4]", ElementType::kU8);
  expect_region({0, 0, 6, 4}, {});
  EXPECT_TRUE(notes_.empty());
  for (const std::string section :
       {"[0:0,0:0]", "[3:7,1:4]", "[4:2,1:4]", "[1:6,4:2]", "everything"}) {
    write_region_cube(section, ElementType::kU8);
    expect_region({0, 0, 6, 4}, {});
    ASSERT_EQ(notes_.size(), 1U);
    EXPECT_TRUE(contains(notes_[0], section)) << notes_[0];
  }
}

TEST_F(FrameRegions, ARegionBeyondTheImageIsRefused) {
  write_region_cube("", ElementType::kU16);
  const std::string text = refusal({.region = PixelRegion{2, 0, 5, 4}});
  EXPECT_TRUE(contains(text, "6 columns") && contains(text, "columns 2 to 6")) << text;
}

TEST(FrameSelection, ARegionIsFourNumbers) {
  EXPECT_FALSE(parse_region(""));
  EXPECT_EQ(parse_region("1,2,30,40"), (PixelRegion{1, 2, 30, 40}));
  EXPECT_EQ(parse_region(" 0, 0, 1, 1 "), (PixelRegion{0, 0, 1, 1}));
  for (const std::string wrong : {"1", "1,2,3", "1,2,3,4,5", "-1,0,4,4", "0,0,0,4", "0,0,4,x",
                                  "2147483647,0,1,1", "99999999999,0,1,1", "[1:2,3:4]"})
    EXPECT_THROW(parse_region(wrong), UsageError) << wrong;
}

}  // namespace
}  // namespace curlew
