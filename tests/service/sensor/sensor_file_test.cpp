// A sensor file that contradicts itself is refused; one with odd pixels hurts nothing.
#include "service/sensor/sensor_file.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <functional>
#include <limits>

#include "centroiding/centroid.h"
#include "service/bench/bench_frames.h"
#include "tests/support/failure_text.h"
#include "tests/support/scratch_directory.h"

namespace curlew {
namespace {

constexpr BenchCase kCase{6, 7, 10};

class SensorFile : public ::testing::Test {
 protected:
  /// Returns why the changed sensor is refused, and the sensor read back in `read` if it is not.
  std::string refusal(const std::function<void(Sensor&)>& change) {
    Sensor sensor = tiled_sensor(kCase);
    add_maps(sensor, 1);
    sensor.flux_adu = Image<float>(kCase.rows, kCase.cols, 1000.0F);
    change(sensor);
    write_sensor(path_, sensor);
    return failure_text([&] { read = read_sensor(path_); });
  }
  void expect_refused(const std::string& word, const std::function<void(Sensor&)>& change) {
    const std::string text = refusal(change);
    EXPECT_NE(text.find(path_), std::string::npos) << word << ": " << text;
    EXPECT_NE(text.find(word), std::string::npos) << text;
    EXPECT_NE(text.find("calibrate again"), std::string::npos) << text;
  }
  Sensor read;
  ScratchDirectory folder_;
  const std::string path_ = folder_ / "sensor.fits";
};

TEST_F(SensorFile, AWholeOneIsRead) {
  EXPECT_EQ(refusal([](Sensor&) {}), "");
  EXPECT_EQ(read.grid.cols, kCase.cols);
  // Spots that a bent wavefront moves by a third of a pitch make no other grid.
  EXPECT_EQ(refusal([](Sensor& s) {
              for (std::size_t k = 0; k < s.valid.size(); ++k)
                s.ref_x_px[k] += k % 2 == 0 ? 3.0F : -3.0F;
            }),
            "");
}

TEST_F(SensorFile, TheGridIsThatOfTheReferenceSpots) {
  expect_refused("P11", [](Sensor& s) { s.grid.p11 = 0.0; });
  expect_refused("ORIGINX", [](Sensor& s) { s.grid.origin_x_px += 15.0; });
  expect_refused("ORIGINX", [](Sensor& s) { s.grid.p12 = 9.0; });
  expect_refused("REFX", [](Sensor& s) { s.grid.p22 *= 1.1; });
  expect_refused("P11", [](Sensor& s) { s.grid.p11 = s.grid.p22 = 1e200; });
}

TEST_F(SensorFile, ItsParityIsThatOfTheOptics) {
  expect_refused("PARITY", [](Sensor& s) { s.grid.p22 = -s.grid.p22; });
  expect_refused("PARITY", [](Sensor& s) { s.optics.mirrored = true; });
}

TEST_F(SensorFile, ValidLensletsHaveNumbersThatMakeSense) {
  constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
  expect_refused("reference", [](Sensor& s) { s.ref_x_px[3] = kNaN; });
  expect_refused("gain", [](Sensor& s) { s.gain_y[3] = 0.0F; });
  expect_refused("FLUX", [](Sensor& s) { s.flux_adu[3] = std::numeric_limits<float>::infinity(); });
  expect_refused("window", [](Sensor& s) { s.window[3].x0 = 1000; });
  expect_refused("WAVELEN", [](Sensor& s) { s.optics.wavelength_m = 1e2; });
  expect_refused("BACKGRND", [](Sensor& s) { s.background_adu = 1e300; });
}

TEST_F(SensorFile, AnUnresponsivePixelIsBad) {
  for (const float response : {1e-30F, 0.001F, 0.05F, 1e30F, -1.0F}) {
    EXPECT_EQ(refusal([&](Sensor& s) { s.flat[100] = response; }), "");
    EXPECT_TRUE(is_bad_pixel(read, 100)) << response;
  }
  EXPECT_EQ(refusal([](Sensor& s) { s.flat[100] = 0.4F; }), "");
  EXPECT_FALSE(is_bad_pixel(read, 100));
  expect_refused("FLAT", [](Sensor& s) {
    for (float& response : s.flat) response = 1e-30F;
  });
}

TEST_F(SensorFile, ADarkBeyondReasonIsABadPixel) {
  EXPECT_EQ(refusal([](Sensor& s) { s.dark_adu[100] = 1e30F; }), "");
  EXPECT_TRUE(is_bad_pixel(read, 100));
}

TEST_F(SensorFile, WhatItWouldTakeOfMemoryIsSaidBefore) {
  const std::string text = refusal([](Sensor& s) {
    s.frame_rows = s.frame_cols = 1 << 20;
    s.dark_adu = s.flat = {};
    s.bad_pixel = {};
  });
  EXPECT_NE(text.find("28587302 MB of memory"), std::string::npos) << text;
  EXPECT_NE(text.find("CURLEW_MEMORY_MB"), std::string::npos) << text;
}

// Whatever the maps hold, what is measured is finite.
TEST_F(SensorFile, CentroidsAreFiniteWhateverTheMapsHold) {
  Sensor sensor = tiled_sensor(kCase);
  add_maps(sensor, 1);
  sensor.detector.saturation_adu = std::numeric_limits<double>::quiet_NaN();
  constexpr std::array<float, 4> kResponses{1e-38F, 1e-30F, 1e-20F, 1e30F};
  for (std::size_t i = 0; i < sensor.flat.size(); i += 37)
    sensor.flat[i] = kResponses[i % kResponses.size()];
  const BenchFrame frame = make_bench_frame(kCase, BenchSlopes::kSmooth, 1);
  for (const CentroidMethod method :
       {CentroidMethod::kPlain, CentroidMethod::kThresholded, CentroidMethod::kMaximumLikelihood}) {
    sensor.method = method;
    CentroidOptions options;
    options.method = method;
    options.max_bad_fraction = 1.0;
    const CentroidPlan plan(sensor, frame.format, options);
    Centroids centroids(kCase.rows, kCase.cols);
    find_centroids(plan, frame.view(), centroids);
    int valid = 0;
    for (std::size_t k = 0; k < centroids.state.size(); ++k) {
      EXPECT_TRUE(std::isfinite(centroids.x_px[k]) && std::isfinite(centroids.y_px[k]) &&
                  std::isfinite(centroids.flux_adu[k]) &&
                  std::isfinite(centroids.variance_x_px2[k]) &&
                  std::isfinite(centroids.covariance_xy_px2[k]))
          << k;
      valid += centroids.state[k] == LensletState::kValid ? 1 : 0;
    }
    EXPECT_EQ(valid, centroids.n_valid);
  }
}

}  // namespace
}  // namespace curlew
