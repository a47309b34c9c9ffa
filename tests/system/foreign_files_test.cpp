// Files as other programs write them: the right frames are read, and it is said; and where nothing
// is measured, the program fails.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "acquisition/fits/fits_file.h"
#include "service/sensor/sensor_file.h"
#include "tests/support/program.h"

namespace curlew {
namespace {

constexpr std::int64_t kForeignFrames = 4;
constexpr int kOverscan = 20;  // columns

using Pixels = std::vector<std::uint16_t>;

class ForeignFiles : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = std::make_unique<ScratchDirectory>();
    const std::string small = "--rows 8 --cols 8 --photons 3000 --out ";
    run("simulate --frames 20 " + small + "ref.fits");
    run("simulate --preset tilt --tilt 1.5,0 --frames 4 " + small + "frames.fits");
    run("calibrate ref.fits --out sensor.fits");
    FitsFile file = FitsFile::open(*folder_ / "frames.fits");
    const ImageInfo info = file.image();
    rows_ = info.shape[1];
    cols_ = info.shape[2];
    pixels_ = Pixels(static_cast<std::size_t>(info.elements()));
    file.read_pixels(0, std::span(pixels_));
    expected_ = mean_slope("frames.fits");
    ASSERT_NEAR(expected_, 1.5, 0.1);
  }
  static void TearDownTestSuite() { folder_.reset(); }

  static ProgramRun run(const std::string& arguments) {
    ProgramRun program = run_curlew(*folder_, arguments);
    EXPECT_EQ(program.exit_code, 0) << arguments << "\n" << program.err;
    return program;
  }

  /// Returns the mean slope along x over all frames, of which there must be kForeignFrames.
  static double mean_slope(const std::string& name, const std::string& more = "",
                           const std::string& sensor = "sensor.fits") {
    said_ = run("replay " + name + " --sensor " + sensor + " --force --out r.fits --save slopes " +
                more)
                .out;
    FitsFile file = FitsFile::open(*folder_ / "r.fits");
    file.select("SLOPES");
    const ImageInfo info = file.image();
    EXPECT_EQ(info.shape[0], kForeignFrames);
    std::vector<double> slopes(static_cast<std::size_t>(info.elements()));
    file.read_pixels(0, std::span(slopes));
    const auto lenslets = static_cast<std::size_t>(info.shape[2] * info.shape[3]);
    double sum = 0.0;
    double count = 0.0;
    for (std::size_t k = 0; k < slopes.size(); ++k) {
      if (k / lenslets % 2 != 0 || std::isnan(slopes[k])) continue;
      sum += slopes[k];
      ++count;
    }
    EXPECT_GT(count, 200.0) << "64 lenslets in 4 frames";
    return sum / count;
  }

  static void write(const std::string& name, const std::function<void(FitsFile&)>& fill) {
    FitsFile file = FitsFile::create(*folder_ / name);
    fill(file);
    file.commit();
  }

  static Pixels plane(std::int64_t n) {
    const std::int64_t size = rows_ * cols_;
    return {pixels_.begin() + n * size, pixels_.begin() + (n + 1) * size};
  }

  template <typename T>
  static void add_image(FitsFile& file, ElementType element, const std::string& name,
                        const std::vector<std::int64_t>& shape, const std::vector<T>& pixels) {
    file.create_image(element, shape, name);
    file.write_pixels(0, std::span<const T>(pixels));
  }

  static void expect_said(const std::string& words) {
    EXPECT_NE(said_.find(words), std::string::npos) << said_;
  }

  static std::unique_ptr<ScratchDirectory> folder_;
  static std::string said_;
  static Pixels pixels_;
  static std::int64_t rows_, cols_;
  static double expected_;
};
std::unique_ptr<ScratchDirectory> ForeignFiles::folder_;
std::string ForeignFiles::said_;
Pixels ForeignFiles::pixels_;
std::int64_t ForeignFiles::rows_ = 0;
std::int64_t ForeignFiles::cols_ = 0;
double ForeignFiles::expected_ = 0.0;

TEST_F(ForeignFiles, AFrameAnExtension) {
  write("extensions.fits", [](FitsFile& file) {
    for (std::int64_t n = 0; n < kForeignFrames; ++n)
      add_image(file, ElementType::kU16, std::string("F").append(std::to_string(n)), {rows_, cols_},
                plane(n));
  });
  EXPECT_DOUBLE_EQ(mean_slope("extensions.fits"), expected_);
  expect_said("4 image extensions");
}

TEST_F(ForeignFiles, ADarkBeforeTheFrames) {
  write("dark_first.fits", [](FitsFile& file) {
    add_image(file, ElementType::kU16, "DARK", {rows_, cols_}, Pixels(plane(0).size(), 100));
    add_image(file, ElementType::kU16, "PIXELS", {kForeignFrames, rows_, cols_}, pixels_);
  });
  EXPECT_DOUBLE_EQ(mean_slope("dark_first.fits"), expected_);
  expect_said("HDU 2, PIXELS, is read");
  EXPECT_DOUBLE_EQ(mean_slope("dark_first.fits", "--hdu pixels"), expected_);
  // calibrate takes the frames and the dark from where their names are.
  run("calibrate dark_first.fits --dark dark_first.fits --pitch-um 80 --focal-mm 2.5 --pixel-um 10 "
      "--wavelength-nm 633 --out named.fits");
  const Image<float> dark = read_sensor(*folder_ / "named.fits").dark_adu;
  ASSERT_FALSE(dark.empty());
  EXPECT_EQ(dark(0, 0), 100.0F);
}

TEST_F(ForeignFiles, WhatIsUnclearIsRefused) {
  write("unclear.fits", [](FitsFile& file) {
    add_image(file, ElementType::kU16, "OPEN", {kForeignFrames, rows_, cols_}, pixels_);
    add_image(file, ElementType::kU16, "CLOSED", {kForeignFrames, rows_, cols_}, pixels_);
  });
  const ProgramRun refused = run_curlew(*folder_, "replay unclear.fits --sensor sensor.fits");
  EXPECT_EQ(refused.exit_code, 1);
  for (const std::string word : {"OPEN", "CLOSED", "--hdu"})
    EXPECT_NE(refused.err.find(word), std::string::npos) << refused.err;
  EXPECT_DOUBLE_EQ(mean_slope("unclear.fits", "--hdu 2"), expected_);
}

TEST_F(ForeignFiles, OverscanIsLeftOutByDatasecOrByRegion) {
  const auto write_overscan = [](const std::string& name, bool data_section) {
    write(name, [&](FitsFile& file) {
      const std::int64_t wide = cols_ + kOverscan;
      std::vector<double> pixels(static_cast<std::size_t>(kForeignFrames * rows_ * wide), -5000.0);
      for (std::size_t k = 0; k < pixels_.size(); ++k) {
        const auto cols = static_cast<std::size_t>(cols_);
        pixels[k / cols * static_cast<std::size_t>(wide) + kOverscan + k % cols] = pixels_[k];
      }
      add_image(file, ElementType::kI32, "", {kForeignFrames, rows_, wide}, pixels);
      if (data_section) {
        std::string section = "[21:";
        section += std::to_string(wide) + ",1:" + std::to_string(rows_) + "]";
        file.write_key("DATASEC", section);
      }
    });
  };
  write_overscan("section.fits", true);
  write_overscan("plain.fits", false);
  const std::string optics =
      " --pitch-um 80 --focal-mm 2.5 --pixel-um 10 --wavelength-nm 633 --out ";
  std::string region = "--region ";
  region += std::to_string(kOverscan) + ",0," + std::to_string(cols_) + "," + std::to_string(rows_);
  run("calibrate section.fits" + optics + "s1.fits");
  run("calibrate plain.fits " + region + optics + "s2.fits");
  const Sensor by_section = read_sensor(*folder_ / "s1.fits");
  const Sensor by_region = read_sensor(*folder_ / "s2.fits");
  EXPECT_EQ(by_section.offset_x_px, kOverscan);
  EXPECT_EQ(by_region.offset_x_px, kOverscan);
  EXPECT_EQ(by_section.frame_cols, cols_);
  EXPECT_EQ(by_section.grid.origin_x_px, by_region.grid.origin_x_px);
  EXPECT_NEAR(mean_slope("section.fits", "", "s2.fits"), 0.0, 0.02) << "it is its own reference";
  expect_said("DATASEC");
  EXPECT_NEAR(mean_slope("plain.fits", region, "s1.fits"), 0.0, 0.02);
  // The whole frame does not fit, and neither does a frame of this size from elsewhere.
  for (const std::string name : {"plain.fits", "frames.fits"})
    EXPECT_EQ(run_curlew(*folder_, "replay " + name + " --sensor s1.fits").exit_code, 1) << name;
}

TEST_F(ForeignFiles, AFlaggedPixelDoesNotHideTheOthers) {
  write("flagged.fits", [](FitsFile& file) {
    std::vector<float> pixels(pixels_.begin(), pixels_.end());
    for (std::int64_t n = 0; n < kForeignFrames; ++n)
      pixels[static_cast<std::size_t>(n * rows_ * cols_)] = -1e30F;
    add_image(file, ElementType::kF32, "", {kForeignFrames, rows_, cols_}, pixels);
  });
  // Maps, of which there is one now, are in codes that round.
  EXPECT_NEAR(mean_slope("flagged.fits"), expected_, 5e-4);
  expect_said("1 pixel that is far outside");
}

TEST_F(ForeignFiles, UnsignedPixelsWithoutTheirKeyAreReadAsUnsigned) {
  write("lost.fits", [](FitsFile& file) {
    std::vector<std::int16_t> pixels;
    for (const std::uint16_t pixel : pixels_)
      pixels.push_back(static_cast<std::int16_t>(pixel - 32768));
    add_image(file, ElementType::kI16, "", {kForeignFrames, rows_, cols_}, pixels);
  });
  EXPECT_DOUBLE_EQ(mean_slope("lost.fits"), expected_);
  expect_said("BZERO");
}

TEST_F(ForeignFiles, NothingMeasuredIsAFailureAndTheResultsAreThere) {
  write("night.fits", [](FitsFile& file) {
    add_image(file, ElementType::kU16, "", {kForeignFrames, rows_, cols_},
              Pixels(pixels_.size(), 100));
  });
  const ProgramRun dark =
      run_curlew(*folder_, "replay night.fits --sensor sensor.fits --out night_results.fits");
  EXPECT_EQ(dark.exit_code, 1);
  EXPECT_EQ(dark.err.rfind("curlew: nothing was measured: ", 0), 0U) << dark.err;
  EXPECT_NE(dark.err.find("100 % too faint"), std::string::npos) << dark.err;
  EXPECT_EQ(dark.out.find("0 vortices"), std::string::npos) << dark.out;
  EXPECT_TRUE(std::filesystem::exists(*folder_ / "night_results.fits"));
  const ProgramRun live = run_curlew(
      *folder_, "run --camera file:night.fits --sensor sensor.fits --frames 4 --seconds 10");
  EXPECT_EQ(live.exit_code, 1);
  EXPECT_NE(live.err.find("nothing was measured: "), std::string::npos) << live.err;
}

}  // namespace
}  // namespace curlew
