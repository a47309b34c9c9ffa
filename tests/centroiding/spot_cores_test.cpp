// Spots with wings are measured by their cores, wherever the wings lie.
#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>

#include "centroiding/calibration/calibrate.h"
#include "centroiding/centroid.h"
#include "centroiding/frame_level.h"
#include "centroiding/sharp_pixels.h"
#include "tests/centroiding/drawn_stack.h"

namespace curlew {
namespace {

constexpr double kBiasAdu = 100.0;
constexpr int kSidePx = 216;

/// A core as sharp as diffraction makes it, and wings with half of the light.
struct WingedSpots {
  double core_x_px = 0.0;
  double core_y_px = 0.0;
  double wings_x_px = 0.0;
  double wings_y_px = 0.0;
  double wings_electrons = 40000.0;

  Image<double> light() const {
    const DrawnStack core{.side_px = kSidePx,
                          .count = 7,
                          .pitch_px = 24.0,
                          .sigma_px = 1.2,
                          .shift_x_px = core_x_px,
                          .shift_y_px = core_y_px,
                          .electrons = 40000.0};
    DrawnStack wings = core;
    wings.sigma_px = 6.0;
    wings.shift_x_px = wings_x_px;
    wings.shift_y_px = wings_y_px;
    wings.electrons = wings_electrons;
    Image<double> sum = core.light();
    const Image<double> more = wings.light();
    for (std::size_t i = 0; i < sum.size(); ++i) sum[i] += more[i];
    return sum;
  }
};

Calibration calibrate(const WingedSpots& spots) {
  CalibrationInput input;
  const Image<double> light = spots.light();
  input.reference_adu = Image<float>(kSidePx, kSidePx);
  for (std::size_t i = 0; i < light.size(); ++i)
    input.reference_adu[i] = static_cast<float>(light[i] + kBiasAdu);
  input.reference_frames = 50;
  input.detector.e_per_adu = 1.0;
  input.detector.read_noise_e = 3.0;
  // λ/w of 2.9 px, and so σ = 1.2 px.
  input.optics.pitch_m = 240e-6;
  input.optics.pixel_m = 10e-6;
  input.optics.wavelength_m = 633e-9;
  input.optics.focal_m = 11e-3;
  return calibrate_sensor(input);
}

struct Frame {
  explicit Frame(const WingedSpots& spots) : counts(kSidePx, kSidePx) {
    const Image<double> light = spots.light();
    for (std::size_t i = 0; i < light.size(); ++i)
      counts[i] = static_cast<std::uint16_t>(std::lround(light[i] + kBiasAdu));
    format.rows = format.cols = kSidePx;
  }
  FrameView view() const {
    return {reinterpret_cast<const std::byte*>(counts.data()), kSidePx, kSidePx, PixelType::kU16};
  }
  Image<std::uint16_t> counts;
  FrameFormat format;
};

/// Returns the mean displacement along x of the valid spots.
double mean_x_px(const Sensor& sensor, const Centroids& centroids) {
  double sum = 0.0;
  int n = 0;
  for (std::size_t k = 0; k < sensor.valid.size(); ++k) {
    if (centroids.state[k] != LensletState::kValid) continue;
    sum += static_cast<double>(centroids.x_px[k] - sensor.ref_x_px[k]) /
           static_cast<double>(sensor.gain_x[k]);
    ++n;
  }
  return n > 0 ? sum / n : kUnknown;
}

TEST(SpotCores, AreWhereTheSpotsLieWhateverTheWingsDo) {
  const Calibration calibration = calibrate({});
  const Sensor& sensor = calibration.sensor;
  ASSERT_GT(calibration.width_over_diffraction, 2.0);
  EXPECT_EQ(sensor.core_threshold, 0.1);
  const Frame frame({.core_x_px = 0.35, .wings_x_px = 2.35, .wings_y_px = -1.0});
  const CentroidPlan plan(sensor, frame.format);
  Centroids centroids(sensor.grid.rows, sensor.grid.cols);
  find_centroids(plan, frame.view(), centroids);
  EXPECT_GT(mean_x_px(sensor, centroids), 0.35 + 0.3) << "the wings must pull all of the light";
  const Image<float> flux = centroids.flux_adu;
  find_core_positions(plan, frame.view(), centroids);
  EXPECT_NEAR(mean_x_px(sensor, centroids), 0.35, 0.05);
  EXPECT_EQ(centroids.n_valid, 49);
  for (std::size_t k = 0; k < flux.size(); ++k) EXPECT_EQ(centroids.flux_adu[k], flux[k]) << k;
}

TEST(SpotCores, AreNotSoughtInSpotsWithoutWings) {
  const Calibration calibration = calibrate({.wings_electrons = 0.0});
  EXPECT_EQ(calibration.sensor.core_threshold, 0.0);
  const Frame frame({.core_x_px = 0.35, .wings_electrons = 0.0});
  const CentroidPlan plan(calibration.sensor, frame.format);
  Centroids centroids(calibration.sensor.grid.rows, calibration.sensor.grid.cols);
  find_centroids(plan, frame.view(), centroids);
  const Image<float> x = centroids.x_px;
  find_core_positions(plan, frame.view(), centroids);
  for (std::size_t k = 0; k < x.size(); ++k) EXPECT_EQ(centroids.x_px[k], x[k]) << k;
}

TEST(SpotCores, ACosmicRayHidesNoCore) {
  const Calibration calibration = calibrate({});
  const Sensor& sensor = calibration.sensor;
  Frame frame({.core_x_px = 0.35});
  const Window& hit = sensor.window(3, 3);
  frame.counts(hit.y0 + 2, hit.x0 + 2) = 60000;
  const CentroidOptions options;
  const CentroidPlan plan(sensor, frame.format, options);
  const LevelPlan level_plan(sensor, plan, options);
  FrameLevels levels(level_plan);
  const SharpPixelPlan sharp_plan(sensor, frame.format);
  SharpPixels sharp(sensor.valid.rows(), sensor.valid.cols());
  measure_levels(level_plan, level_plan.pixels(), frame.view(), levels);
  find_sharp_pixels(sharp_plan, plan, plan.spots, frame.view(), levels, sharp);
  Centroids centroids(sensor.grid.rows, sensor.grid.cols);
  const FrameConditions conditions{&levels, &sharp};
  find_centroids(plan, frame.view(), centroids, conditions);
  find_core_positions(plan, frame.view(), centroids, conditions);
  EXPECT_GE(sharp.first(3, 3), 0) << "the hit must be seen";
  EXPECT_EQ(centroids.n_valid, 49);
  EXPECT_NEAR(centroids.x_px(3, 3) - sensor.ref_x_px(3, 3),
              centroids.x_px(2, 3) - sensor.ref_x_px(2, 3), 0.02);
  EXPECT_NEAR(mean_x_px(sensor, centroids), 0.35, 0.02);
}

}  // namespace
}  // namespace curlew
