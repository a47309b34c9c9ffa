// A sensor file that contradicts itself is refused; one with odd pixels hurts nothing.
#include "service/sensor/sensor_file.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>

#include "centroiding/centroid.h"
#include "service/bench/bench_frames.h"
#include "tests/support/failure_text.h"
#include "tests/support/raw_fits.h"
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
  /// Returns why a good file is refused after one card of an HDU was changed; hdu: its name, empty
  /// for the primary.
  std::string refusal_of_card(const std::string& hdu, const std::string& key,
                              const std::string& value) {
    EXPECT_EQ(refusal([](Sensor&) {}), "");
    std::string bytes = read_bytes(path_);
    std::string card = raw_card(key, value);
    const std::size_t begin =
        hdu.empty() ? 0 : bytes.rfind("XTENSION", bytes.find("EXTNAME = '" + hdu));
    const std::size_t at = bytes.find(card.substr(0, 9), begin);
    if (at == std::string::npos) return "there is no card " + key;
    card.resize(80, ' ');
    std::copy(card.begin(), card.end(), bytes.begin() + static_cast<std::ptrdiff_t>(at));
    write_bytes(path_, bytes);
    return failure_text([&] { read_sensor(path_); });
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

TEST_F(SensorFile, BendsComeBackAndMakeSense) {
  constexpr std::array kBends{&Sensor::bend2_x, &Sensor::bend2_y, &Sensor::bend3_x,
                              &Sensor::bend3_y};
  EXPECT_EQ(refusal([](Sensor&) {}), "");
  for (const auto map : kBends) EXPECT_TRUE((read.*map).empty());
  const auto bend = [&](Sensor& s) {
    float value = 0.1F;
    for (const auto map : kBends) {
      s.*map = Image<float>(kCase.rows, kCase.cols);
      for (float& of_lenslet : s.*map) of_lenslet = value += 0.001F;
    }
  };
  Sensor bent;
  EXPECT_EQ(refusal([&](Sensor& s) {
              bend(s);
              bent = s;
            }),
            "");
  for (const auto map : kBends) {
    ASSERT_EQ((read.*map).size(), (bent.*map).size());
    for (std::size_t k = 0; k < (bent.*map).size(); ++k) EXPECT_EQ((read.*map)[k], (bent.*map)[k]);
  }
  for (const auto map : kBends)
    expect_refused("BEND", [&](Sensor& s) {
      bend(s);
      (s.*map)[3] = std::numeric_limits<float>::quiet_NaN();
    });
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
  expect_refused("WAVELEN", [](Sensor& s) { s.optics.wavelength_m = s.optics.focal_m = 1e-8; });
  expect_refused("BACKGRND", [](Sensor& s) { s.background_adu = 1e300; });
}

TEST_F(SensorFile, WindowsLieOnTheDetector) {
  constexpr int kMost = std::numeric_limits<int>::max();
  const auto expect = [&](int Window::*side, int value) {
    expect_refused("window", [&](Sensor& s) { s.window[3].*side = value; });
  };
  for (int Window::*side : {&Window::x0, &Window::y0})
    for (const int value : {-1, 1000, kMost}) expect(side, value);
  for (int Window::*side : {&Window::w, &Window::h})
    for (const int value : {0, -5, 1000, kMost}) expect(side, value);
}

TEST_F(SensorFile, EveryReferenceAndGainIsLookedAt) {
  for (Image<float> Sensor::*map : {&Sensor::ref_x_px, &Sensor::ref_y_px})
    for (const float value : {-1e9F, 1e9F})
      expect_refused("valid but its reference", [&](Sensor& s) { (s.*map)[3] = value; });
  for (Image<float> Sensor::*map : {&Sensor::gain_x, &Sensor::gain_y})
    for (const float value : {0.0F, -1.0F, 1e9F})
      expect_refused("gain", [&](Sensor& s) { (s.*map)[3] = value; });
}

TEST_F(SensorFile, SizesAreWholeNumbersThatMakeSense) {
  for (const std::string key : {"ROWS", "COLS", "NX", "NY"})
    for (const char* value : {"0", "-3", "4.5", "2000000"})
      EXPECT_NE(refusal_of_card("", key, value).find(key + " is not a size"), std::string::npos)
          << key << " = " << value;
  for (const std::string key : {"P11", "ORIGINY"})
    EXPECT_NE(refusal_of_card("", key, "").find(key + " is missing"), std::string::npos);
}

TEST_F(SensorFile, MapsHaveTheSizesOfTheirGrid) {
  expect_refused("REFY", [](Sensor& s) { s.ref_y_px = Image<float>(2, 3); });
  expect_refused("VALID", [](Sensor& s) { s.valid = Image<std::uint8_t>(42, 1); });
  expect_refused("DARK", [](Sensor& s) { s.dark_adu = Image<float>(3, 3); });
  expect_refused("FLAT", [](Sensor& s) { s.flat = Image<float>(3, 3); });
  expect_refused("BADPIX", [](Sensor& s) { s.bad_pixel = Image<std::uint8_t>(3, 3); });
  for (const char* hdu : {"WINDOW", "GAIN"})
    EXPECT_NE(refusal_of_card(hdu, "NAXIS3", "1").find(hdu), std::string::npos);
}

TEST_F(SensorFile, WordsAreThoseThatAreKnown) {
  EXPECT_NE(refusal_of_card("", "CENTROID", "'best'").find("method best"), std::string::npos);
  EXPECT_NE(refusal_of_card("", "LAYOUT", "'HEX'").find("HEX"), std::string::npos);
  expect_refused("CORETHR", [](Sensor& s) { s.core_threshold = 1.5; });
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
