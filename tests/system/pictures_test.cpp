// Pictures of laboratories are read like recordings, pictures of what was found are drawn, bad
// pixels are mapped, and mistakes with formats and options are refused.
#include <gtest/gtest.h>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "acquisition/fits/fits_file.h"
#include "acquisition/pictures/picture_file.h"
#include "service/sensor/sensor_file.h"
#include "tests/acquisition/pictures/written_pictures.h"
#include "tests/support/program.h"

namespace curlew {
namespace {

class PicturesOfUsers : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = std::make_unique<ScratchDirectory>();
    const std::string small = "--rows 8 --cols 8 --photons 3000 --out ";
    run("simulate --frames 20 " + small + "ref.fits");
    run("simulate --preset dipole --frames 4 " + small + "frames.fits");
    run("calibrate ref.fits --out sensor.fits --picture sensor.png");
    FitsFile file = FitsFile::open(*folder_ / "frames.fits");
    const ImageInfo info = file.image();
    rows_ = static_cast<int>(info.shape[1]);
    cols_ = static_cast<int>(info.shape[2]);
    pixels_.resize(static_cast<std::size_t>(info.elements()));
    file.read_pixels(0, std::span(pixels_));
  }
  static void TearDownTestSuite() { folder_.reset(); }

  static ProgramRun run(const std::string& arguments) {
    ProgramRun program = run_curlew(*folder_, arguments);
    EXPECT_EQ(program.exit_code, 0) << arguments << "\n" << program.err;
    return program;
  }

  static void expect_refused(const std::string& arguments, int exit_code,
                             const std::string& words) {
    const ProgramRun program = run_curlew(*folder_, arguments);
    EXPECT_EQ(program.exit_code, exit_code) << arguments << "\n" << program.err;
    EXPECT_NE(program.err.find(words), std::string::npos) << program.err;
  }

  static std::vector<float> slopes_of(const std::string& frames) {
    run("replay " + frames +
        " --sensor sensor.fits --out r.fits --force --save slopes,phase --show 0");
    FitsFile file = FitsFile::open(*folder_ / "r.fits");
    file.select("SLOPES");
    std::vector<float> slopes(static_cast<std::size_t>(file.image().elements()));
    file.read_pixels(0, std::span(slopes));
    return slopes;
  }

  static std::unique_ptr<ScratchDirectory> folder_;
  static std::vector<std::uint16_t> pixels_;
  static int rows_, cols_;
};
std::unique_ptr<ScratchDirectory> PicturesOfUsers::folder_;
std::vector<std::uint16_t> PicturesOfUsers::pixels_;
int PicturesOfUsers::rows_ = 0;
int PicturesOfUsers::cols_ = 0;

TEST_F(PicturesOfUsers, StacksAndSequencesGiveTheSlopesOfTheRecording) {
  const std::vector<float> expected = slopes_of("frames.fits");
  ASSERT_EQ(expected.size(), 4U * 2U * 64U);
  write_tiff(*folder_ / "stack.tif", rows_, cols_, pixels_, {});
  EXPECT_EQ(slopes_of("stack.tif"), expected);
  write_npy(*folder_ / "stack.npy", "'<u2'",
            "(4, " + std::to_string(rows_) + ", " + std::to_string(cols_) + ")", pixels_);
  EXPECT_EQ(slopes_of("stack.npy"), expected);
  std::filesystem::create_directory(*folder_ / "sequence");
  const std::size_t frame = pixels_.size() / 4;
  for (std::size_t n = 0; n < 4; ++n) {
    const auto begin = pixels_.begin() + static_cast<std::ptrdiff_t>(n * frame);
    write_png_16(*folder_ / ("sequence/f" + std::to_string(8 + n) + ".png"), rows_, cols_,
                 {begin, begin + static_cast<std::ptrdiff_t>(frame)});
  }
  EXPECT_EQ(slopes_of("sequence"), expected);
  EXPECT_EQ(slopes_of("'sequence/f*.png'"), expected);
  // Cameras of files take them too, and so does calibration, for which they hold no optics.
  const ProgramRun live =
      run("run --camera file:sequence --sensor sensor.fits --frames 4 --seconds 20");
  EXPECT_NE(live.out.find("4 frames delivered"), std::string::npos) << live.out;
  expect_refused("calibrate stack.tif --out x.fits", 2, "--pitch-um");
}

TEST_F(PicturesOfUsers, WhatWasFoundIsDrawn) {
  const ProgramRun drawn =
      run("replay frames.fits --sensor sensor.fits --show 0 --picture 2:frame.png");
  EXPECT_NE(drawn.out.find("frame.png: frame 2"), std::string::npos) << drawn.out;
  for (const std::string name : {"sensor.png", "frame.png"}) {
    png_image image{};
    image.version = PNG_IMAGE_VERSION;
    ASSERT_NE(png_image_begin_read_from_file(&image, (*folder_ / name).c_str()), 0) << name;
    EXPECT_GE(image.width, 8U * 24U) << "a lenslet is 24 px wide at least";
    image.format = PNG_FORMAT_RGB;
    std::vector<std::uint8_t> rgb(std::size_t{3} * image.width * image.height);
    ASSERT_NE(png_image_finish_read(&image, nullptr, rgb.data(), 0, nullptr), 0);
    std::size_t green = 0;
    std::size_t yellow = 0;
    std::size_t blue = 0;
    for (std::size_t i = 0; i < rgb.size(); i += 3) {
      green += rgb[i + 1] > rgb[i] + 100 && rgb[i + 1] > rgb[i + 2] + 80 ? 1U : 0U;
      yellow += rgb[i] > rgb[i + 2] + 150 && rgb[i + 1] > rgb[i + 2] + 150 ? 1U : 0U;
      blue += rgb[i + 2] > rgb[i] + 150 ? 1U : 0U;
    }
    EXPECT_GT(green, 64U * 4U * 20U) << name << ": an outline for each of 64 windows";
    EXPECT_GT(yellow, 64U) << name << ": crosses or arrows";
    EXPECT_EQ(blue > 50U, name == "frame.png") << "the negative vortex of the pair";
  }
  expect_refused("replay frames.fits --sensor sensor.fits --picture 9:x.png", 1, "no frame 9");
  expect_refused("replay frames.fits --sensor sensor.fits --picture x.png", 2, "FRAME:FILE.png");
  expect_refused("replay frames.fits --sensor sensor.fits --picture 0:sensor.fits", 2,
                 "sensor.fits");
}

TEST_F(PicturesOfUsers, BadPixelsAreMappedAndTakenUp) {
  const std::size_t frame = pixels_.size() / 4;
  std::vector<std::uint16_t> darks(frame * 8);
  for (std::size_t i = 0; i < darks.size(); ++i)
    darks[i] = static_cast<std::uint16_t>(100 + i * 7919 % 5);  // of noise 1.4
  const auto hot = static_cast<std::size_t>(20 * cols_ + 30);
  for (std::size_t n = 0; n < 8; ++n) darks[n * frame + hot] = 900;
  write_tiff(*folder_ / "darks.tif", rows_, cols_, darks, {});
  const ProgramRun made = run("calibrate --make-bad-pixels darks.tif --out bad.fits");
  EXPECT_NE(made.out.find("bad.fits: 1 of 4096 pixels are bad: 1 far off"), std::string::npos)
      << made.out;
  run("calibrate ref.fits --bad-pixels bad.fits --out masked.fits");
  const Image<std::uint8_t> map = read_sensor(*folder_ / "masked.fits").bad_pixel;
  ASSERT_FALSE(map.empty());
  EXPECT_EQ(map(20, 30), 1);
  EXPECT_EQ(map(20, 31), 0);
  expect_refused("calibrate --make-bad-pixels ref.fits --out x.fits", 1, "is not dark");
  expect_refused("calibrate ref.fits --make-bad-pixels darks.tif --out x.fits", 2, "excludes");
}

TEST_F(PicturesOfUsers, AnotherPixelFormatIsRefused) {
  EXPECT_EQ(read_sensor(*folder_ / "sensor.fits").pixel_bits, 16);
  std::vector<std::uint8_t> eight(pixels_.size());
  for (std::size_t i = 0; i < eight.size(); ++i)
    eight[i] = static_cast<std::uint8_t>(pixels_[i] / 16);
  write_tiff(*folder_ / "eight.tif", rows_, cols_, eight, {.bits = 8});
  expect_refused("replay eight.tif --sensor sensor.fits", 1, "pixel format");
}

TEST_F(PicturesOfUsers, OptionsWithoutEffectAreRefused) {
  expect_refused("replay frames.fits --sensor sensor.fits --method classifier --false-alarms 0.1",
                 2, "no effect on the method classifier");
  expect_refused("calibrate ref.fits --frames 10 --out x.fits", 2, "--frames requires --camera");
  expect_refused("calibrate ref.fits --dark-hdu 2 --out x.fits", 2, "--dark-hdu");
}

TEST_F(PicturesOfUsers, TheFirstLineSaysWhichMethodWasTakenAndWhy) {
  const ProgramRun replayed = run("replay frames.fits --sensor sensor.fits");
  EXPECT_EQ(replayed.out.rfind("method whitened, chosen by auto: ", 0), 0U) << replayed.out;
  const ProgramRun calibrated = run("calibrate ref.fits --out again.fits");
  EXPECT_NE(calibrated.out.find("methods that suit these spots: circulation, whitened"),
            std::string::npos)
      << calibrated.out;
}

}  // namespace
}  // namespace curlew
