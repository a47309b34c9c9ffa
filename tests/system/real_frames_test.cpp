// Frames of real sensors: no vortex may be seen in them, and a known shift must be measured.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "acquisition/fits/fits_file.h"
#include "acquisition/recording/mean_image.h"
#include "service/sensor/sensor_file.h"
#include "tests/support/paths.h"
#include "tests/support/program.h"
#include "tests/support/sanitized.h"

namespace curlew {
namespace {

struct RealFrame {
  const char* name;
  const char* optics;
};

constexpr RealFrame kRealFrames[] = {
    {"mmirs_camera2_ref", "--pitch-um 600 --focal-mm 40 --pixel-um 26 --wavelength-nm 762"},
    {"f5_hecto_ref", "--pitch-um 600 --focal-mm 40 --pixel-um 20 --wavelength-nm 600"},
    {"auto_wfs_0037_ave", "--pitch-um 600 --focal-mm 40 --pixel-um 20 --wavelength-nm 600"}};

std::string path_of(const char* name) { return std::string(kFramesDir) + "/" + name + ".fits"; }

class RealFrames : public ::testing::TestWithParam<RealFrame> {
 protected:
  void SetUp() override {
    if (!std::filesystem::exists(path_of(GetParam().name)))
      GTEST_SKIP() << "the folder of real frames is not beside this checkout";
    calibrate("");
  }
  void calibrate(const std::string& more) {
    const ProgramRun run =
        run_curlew(scratch_, "calibrate '" + path_of(GetParam().name) + "' " + GetParam().optics +
                                 more + " --force --out sensor.fits");
    ASSERT_EQ(run.exit_code, 0) << run.err;
    EXPECT_NE(run.out.find("px rms from the grid"), std::string::npos) << run.out;
  }

  /// Replays, and returns the slopes [2, lenslets]. `vortices` is set to how many were found.
  std::vector<double> slopes_of(const std::string& recording, std::int64_t& vortices,
                                const std::string& method = "circulation") {
    const ProgramRun run =
        run_curlew(scratch_, "replay '" + recording + "' --sensor sensor.fits --method " + method +
                                 " --force --out results.fits --save slopes");
    EXPECT_EQ(run.exit_code, 0) << run.err;
    said_ = run.out;
    FitsFile file = FitsFile::open(scratch_ / "results.fits");
    file.select("VORTICES");
    vortices = file.row_count();
    file.select("SLOPES");
    std::vector<double> slopes(static_cast<std::size_t>(file.image().elements()));
    file.read_pixels<double>(0, slopes);
    return slopes;
  }

  ScratchDirectory scratch_;
  std::string said_;  ///< what the last replay printed
};

TEST_P(RealFrames, OnItsOwnCalibrationEverySlopeIsExactlyZero) {
  std::int64_t vortices = -1;
  const std::vector<double> slopes = slopes_of(path_of(GetParam().name), vortices);
  EXPECT_EQ(vortices, 0);
  const auto valid = std::count_if(slopes.begin(), slopes.end(), [](double s) { return s == 0.0; });
  const Sensor sensor = read_sensor(scratch_ / "sensor.fits");
  EXPECT_EQ(valid, 2 * std::count(sensor.valid.begin(), sensor.valid.end(), 1));
  for (const double s : slopes) EXPECT_TRUE(std::isnan(s) || s == 0.0);
}

// The lamps' spots have sharp cores. Those of the sky are more blurred than the classifier knows,
// and it must say so instead of taking them for vortices.
TEST_P(RealFrames, OnItsOwnCalibrationNoMethodFindsAVortex) {
  std::int64_t vortices = -1;
  slopes_of(path_of(GetParam().name), vortices, "whitened");
  EXPECT_EQ(vortices, 0);
  if (GetParam().name != kRealFrames[2].name) {
    slopes_of(path_of(GetParam().name), vortices, "classifier");
    EXPECT_EQ(vortices, 0);
    return;
  }
  const ProgramRun run = run_curlew(scratch_, "replay '" + path_of(GetParam().name) +
                                                  "' --sensor sensor.fits --method classifier");
  EXPECT_EQ(run.exit_code, 2);
  EXPECT_NE(run.err.find("spots are blurred"), std::string::npos) << run.err;
}

double median_peak_adu(const MeanImage& frame, const Sensor& sensor) {
  std::vector<double> peaks;
  for (std::size_t k = 0; k < sensor.valid.size(); ++k) {
    const Window& w = sensor.window[k];
    double peak = -1e300;
    for (int y = w.y0; y < w.y0 + w.h; ++y)
      for (int x = w.x0; x < w.x0 + w.w; ++x) peak = std::max(peak, frame.mean(y, x));
    if (sensor.valid[k] != 0) peaks.push_back(peak - sensor.background_adu);
  }
  std::nth_element(peaks.begin(), peaks.begin() + static_cast<std::ptrdiff_t>(peaks.size() / 2),
                   peaks.end());
  return peaks[peaks.size() / 2];
}

/// Writes the frame shifted by whole pixels, with its rim repeated and Gaussian noise.
void write_shifted(const MeanImage& frame, int dx, int dy, double noise_adu, unsigned seed,
                   const std::string& path) {
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0.0, noise_adu);
  const int rows = frame.mean.rows();
  const int cols = frame.mean.cols();
  std::vector<float> pixels;
  for (int y = 0; y < rows; ++y)
    for (int x = 0; x < cols; ++x)
      pixels.push_back(static_cast<float>(
          frame.mean(std::clamp(y - dy, 0, rows - 1), std::clamp(x - dx, 0, cols - 1)) +
          noise(random)));
  FitsFile file = FitsFile::create(path);
  file.create_image(ElementType::kF32, {rows, cols});
  file.write_pixels<float>(0, pixels);
  file.commit();
}

TEST_P(RealFrames, AKnownShiftIsMeasuredAndIsNoVortex) {
  const MeanImage frame = read_mean_image(path_of(GetParam().name));
  const double noise_adu = 0.01 * median_peak_adu(frame, read_sensor(scratch_ / "sensor.fits"));
  unsigned seed = 7601;

  // The reference frames have a twentieth of that noise. The sensor file must know the noise, as a
  // user knows that of his camera. If it does not, replay must say so.
  write_shifted(frame, 1, 0, noise_adu, seed, scratch_ / "shifted.fits");
  std::int64_t ignored = 0;
  slopes_of(scratch_ / "shifted.fits", ignored);
  if (GetParam().name != kRealFrames[2].name) {  // the sky of the star is as uneven as the noise
    EXPECT_NE(said_.find("calibrate again with --read-noise-e"), std::string::npos) << said_;
  }
  calibrate(" --e-per-adu 1 --read-noise-e " + std::to_string(noise_adu));

  const Sensor sensor = read_sensor(scratch_ / "sensor.fits");
  const std::size_t lenslets = sensor.valid.size();
  std::vector<std::pair<int, int>> shifts{{1, 0}, {-1, 1}};
  if (!kSanitized) shifts.insert(shifts.end(), {{-1, 0}, {0, 1}, {0, -1}, {1, 1}});
  for (const auto& [dx, dy] : shifts) {
    SCOPED_TRACE("shift " + std::to_string(dx) + "," + std::to_string(dy) + " seed " +
                 std::to_string(seed));
    write_shifted(frame, dx, dy, noise_adu, seed++, scratch_ / "shifted.fits");
    std::int64_t vortices = -1;
    if (GetParam().name != kRealFrames[2].name) {
      slopes_of(scratch_ / "shifted.fits", vortices, "classifier");
      EXPECT_EQ(vortices, 0) << "of the classifier";
    }
    const std::vector<double> slopes = slopes_of(scratch_ / "shifted.fits", vortices);
    EXPECT_EQ(vortices, 0);
    const double px = 1.0 / (sensor.optics.slope_rad_per_px() * sensor.grid.pitch_px());
    double square_error = 0.0;
    int valid = 0;
    for (std::size_t k = 0; k < lenslets; ++k) {
      const double along_cols = slopes[k] * px;
      const double along_rows = slopes[lenslets + k] * px;
      if (std::isnan(along_cols)) continue;
      const double x = sensor.grid.p11 * along_cols + sensor.grid.p12 * along_rows;
      const double y = sensor.grid.p21 * along_cols + sensor.grid.p22 * along_rows;
      square_error += (x - dx) * (x - dx) + (y - dy) * (y - dy);
      ++valid;
    }
    const double rms = std::sqrt(square_error / (2.0 * valid));
    std::printf("%s shifted by (%+d, %+d): %d lenslets, rms %.4f px\n", GetParam().name, dx, dy,
                valid, rms);
    EXPECT_GT(valid, 9 * std::count(sensor.valid.begin(), sensor.valid.end(), 1) / 10);
    EXPECT_LT(rms, 0.05);
  }
}

INSTANTIATE_TEST_SUITE_P(Mmt, RealFrames, ::testing::ValuesIn(kRealFrames),
                         [](const auto& frame) { return std::string(frame.param.name); });

// The spots of these skies are wider than the lamps', their pupils smaller, and an exposure of
// seconds holds no vortex. When the classifier did not know the blur of the frame, it saw 25
// and 64.
TEST(RealSkies, HoldNoVortex) {
  for (const auto& [sky, lamp] : {std::pair{"mmirs_wfs_0150", kRealFrames[0]},
                                  std::pair{"auto_wfs_0037_ave", kRealFrames[1]}}) {
    if (!std::filesystem::exists(path_of(sky)))
      GTEST_SKIP() << "the folder of real frames is not beside this checkout";
    const ScratchDirectory scratch;
    ASSERT_EQ(run_curlew(scratch, "calibrate '" + path_of(lamp.name) + "' " + lamp.optics +
                                      " --out sensor.fits")
                  .exit_code,
              0);
    for (const char* method : {"whitened", "classifier"}) {
      const ProgramRun run = run_curlew(
          scratch, "replay '" + path_of(sky) + "' --sensor sensor.fits --method " + method);
      EXPECT_EQ(run.exit_code, 0) << run.err;
      EXPECT_NE(run.out.find("1 frames, 0 vortices"), std::string::npos)
          << sky << " by " << method << "\n"
          << run.out;
    }
  }
}

TEST(RealFramesRefused, AHexagonalGridByName) {
  if (!std::filesystem::exists(path_of("f9_ref")))
    GTEST_SKIP() << "the folder of real frames is not beside this checkout";
  const ScratchDirectory scratch;
  const ProgramRun run = run_curlew(
      scratch, "calibrate '" + path_of("f9_ref") +
                   "' --pitch-um 625 --focal-mm 45 --pixel-um 20 --wavelength-nm 780 --out s.fits");
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_NE(run.err.find("hexagonal"), std::string::npos) << run.err;
  EXPECT_TRUE(scratch.names().empty());
}

}  // namespace
}  // namespace curlew
