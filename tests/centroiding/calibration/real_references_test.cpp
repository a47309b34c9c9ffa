// These tests compare the grids of real frames with lists made by eye, which are in
// tests/centroiding/calibration/spots/.
#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "acquisition/recording/mean_image.h"
#include "centroiding/calibration/calibrate.h"
#include "centroiding/calibration/lenslet_grid_finder.h"
#include "core/error.h"
#include "tests/support/paths.h"

namespace curlew {
namespace {

struct SeenSpot {
  double x = 0.0;
  double y = 0.0;
  bool faint = false;
};

std::vector<SeenSpot> read_list(const std::string& name) {
  const std::string path =
      std::string(kSourceDir) + "/tests/centroiding/calibration/spots/" + name + ".txt";
  std::ifstream file(path);
  EXPECT_TRUE(file.is_open()) << path;
  std::vector<SeenSpot> spots;
  for (std::string line; std::getline(file, line);) {
    if (line.empty() || line.front() == '#') continue;
    std::istringstream words(line);
    SeenSpot spot;
    std::string mark;
    words >> spot.x >> spot.y >> mark;
    spot.faint = mark == "faint";
    spots.push_back(spot);
  }
  return spots;
}

std::string frame_path(const std::string& name) {
  return std::string(kFramesDir) + "/" + name + ".fits";
}

Image<float> read_frame(const std::string& name) {
  const MeanImage read = read_mean_image(frame_path(name));
  Image<float> image(read.mean.rows(), read.mean.cols());
  for (std::size_t i = 0; i < image.size(); ++i) image[i] = static_cast<float>(read.mean[i]);
  return image;
}

class RealFrames : public testing::Test {
 protected:
  void SetUp() override {
    if (!std::filesystem::exists(frame_path("f9_ref"))) {
      GTEST_SKIP() << "no real frames in " << kFramesDir;
    }
  }
};

/// A listed position is a centre of mass of 5 to 11 px. A lenslet's is that of the light above a
/// fifth of the peak. On elongated spots the two differ by a pixel or two.
constexpr double kSamePx = 4.0;

void expect_every_spot_and_nothing_else(const std::string& name, double pitch_px,
                                        double residual_px) {
  SCOPED_TRACE(name);
  const std::vector<SeenSpot> seen = read_list(name);
  const FoundGrid found = find_lenslet_grid(read_frame(name), {}, false);
  for (const SeenSpot& spot : seen) {
    int n = 0;
    for (std::size_t k = 0; k < found.lit.size(); ++k) {
      if (found.lit[k] == 0) continue;
      const double distance = std::hypot(static_cast<double>(found.spot_x_px[k]) - spot.x,
                                         static_cast<double>(found.spot_y_px[k]) - spot.y);
      n += distance < kSamePx ? 1 : 0;
    }
    if (!spot.faint) {
      EXPECT_EQ(n, 1) << "spot at " << spot.x << ", " << spot.y;
    }
  }
  for (std::size_t k = 0; k < found.lit.size(); ++k) {
    if (found.lit[k] == 0) continue;
    bool listed = false;
    for (const SeenSpot& spot : seen) {
      // A faint smear has no clear centre, and may lie anywhere within its lenslet.
      const double reach = spot.faint ? 0.5 * pitch_px : kSamePx;
      listed = listed || std::hypot(static_cast<double>(found.spot_x_px[k]) - spot.x,
                                    static_cast<double>(found.spot_y_px[k]) - spot.y) < reach;
    }
    EXPECT_TRUE(listed) << "the list has no spot at " << found.spot_x_px[k] << ", "
                        << found.spot_y_px[k];
  }
  // The expected values are from quick fits, in which spots at the rim and bad spots were not
  // sorted out.
  EXPECT_NEAR(found.grid.pitch_px(), pitch_px, 0.04);
  EXPECT_LT(found.residual_px, residual_px);
}

TEST_F(RealFrames, EverySpotAPersonSeesAndNothingElse) {
  expect_every_spot_and_nothing_else("mmirs_camera2_ref", 22.68, 0.7);
  expect_every_spot_and_nothing_else("f5_hecto_ref", 29.63, 0.7);
  expect_every_spot_and_nothing_else("auto_wfs_0037_ave", 30.44, 1.5);
}

TEST_F(RealFrames, AHexagonalSensorIsNamedAndRefused) {
  try {
    find_lenslet_grid(read_frame("f9_ref"), {}, false);
    FAIL() << "a hexagonal grid was taken for a square one";
  } catch (const Failure& failure) {
    EXPECT_NE(std::string(failure.what()).find("hexagonal"), std::string::npos);
  }
}

TEST_F(RealFrames, AFaintStarAmongHotPixelsAndStripesStillShowsTheGrid) {
  const FoundGrid found = find_lenslet_grid(read_frame("mmirs_wfs_0150"), {}, false);
  // This is the same sensor as in mmirs_camera2_ref. On the sky the beam's curvature shrinks the
  // grid by 3 %.
  EXPECT_NEAR(found.grid.pitch_px(), 22.1, 0.1);
  EXPECT_NEAR(found.grid.rotation_deg(), -0.52, 0.1);
  // People count 151 to 167 spots, depending on whether they take the faint ones at the rim and at
  // the obscuration.
  EXPECT_GE(found.n_lit, 148);
  EXPECT_LE(found.n_lit, 168);
}

TEST_F(RealFrames, CalibrationKeepsEverySpotOfTheLists) {
  for (const char* name : {"mmirs_camera2_ref", "f5_hecto_ref", "auto_wfs_0037_ave"}) {
    SCOPED_TRACE(name);
    CalibrationInput input;
    input.reference_adu = read_frame(name);
    const Calibration calibration = calibrate_sensor(input);
    const Sensor& sensor = calibration.sensor;
    for (const SeenSpot& spot : read_list(name)) {
      if (spot.faint) continue;
      int n = 0;
      for (std::size_t k = 0; k < sensor.valid.size(); ++k) {
        if (sensor.valid[k] == 0) continue;
        const Window& w = sensor.window[k];
        const bool inside = spot.x >= w.x0 - 0.5 && spot.x < w.x0 + w.w - 0.5 &&
                            spot.y >= w.y0 - 0.5 && spot.y < w.y0 + w.h - 0.5;
        n += inside ? 1 : 0;
      }
      EXPECT_EQ(n, 1) << "window round " << spot.x << ", " << spot.y;
    }
    EXPECT_FALSE(calibration.notes.empty());
  }
}

}  // namespace
}  // namespace curlew
