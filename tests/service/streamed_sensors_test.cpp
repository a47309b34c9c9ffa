// Whatever the sensor, the grid and the frames: rows that are worked on as they come give the bits
// that whole frames give.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <numbers>
#include <random>
#include <string>

#include "centroiding/sensor.h"
#include "service/stages.h"
#include "tests/support/result_bytes.h"

namespace curlew {
namespace {

constexpr int kStreamedFrames = 8;

/// A sensor and a plan as they come, and frames of it.
class RandomScene {
 public:
  explicit RandomScene(unsigned seed) : random_(seed) {
    constexpr std::array kAngles_deg{0.0, 0.7, -2.0, 30.0, 45.0, 180.0};
    const double angle = kAngles_deg[seed % kAngles_deg.size()] * std::numbers::pi / 180.0;
    pitch_px_ = uniform(7.0, 12.0);
    sensor.grid.rows = whole(10, 18);
    sensor.grid.cols = whole(10, 18);
    place_grid(angle);
    make_lenslets(angle);
    sensor.optics = {.pitch_m = 150e-6, .focal_m = 5e-3, .pixel_m = 15e-6, .wavelength_m = 633e-9};
    sensor.detector = {.e_per_adu = 1.0, .read_noise_e = 4.0};
    sensor.spot_sharpness = 1.3;
    sensor.background_adu = 20.0;
    if (whole(0, 1) == 1) make_maps();
  }

  Config config() {
    constexpr std::array kMethods{CentroidMethod::kThresholded, CentroidMethod::kWeighted,
                                  CentroidMethod::kCorrelation};
    Config config;
    config.centroid.measure_ahead = true;
    config.detect.method = DetectMethod::kCirculation;
    config.centroid.method = kMethods[static_cast<std::size_t>(whole(0, 5)) % 4 % 3];
    config.centroid.follow_level = whole(0, 5) > 0;
    config.centroid.follow_windows = whole(0, 5) > 0;
    config.centroid.threshold_relative = whole(0, 4) == 0 ? 0.1 : 0.0;
    sensor.method = config.centroid.method;
    return config;
  }

  /// Draws the next frame: the pattern drifts, a step comes, some spots fade or stray, cosmic rays
  /// hit, and noise grows.
  void draw(int number, FrameBuffer& frame) {
    const double drift_px = (0.04 * number + (number >= 5 ? 0.4 : 0.0)) * pitch_px_;
    const double noise = number == 6 ? 7.0 : 4.0;
    Image<double> light(format.rows, format.cols, 20.0);
    for (int r = 0; r < sensor.grid.rows; ++r) {
      for (int c = 0; c < sensor.grid.cols; ++c) {
        const bool fades = whole(0, 40) == 0;
        const double stray_px = whole(0, 50) == 0 ? 0.4 * pitch_px_ : 0.0;
        const auto [x, y] = sensor.grid.pixel_from_lenslet(c, r);
        add_spot(light, x + drift_px + stray_px + uniform(-0.6, 0.6), y + uniform(-0.6, 0.6),
                 fades ? 20.0 : brightness_);
      }
    }
    for (int hit = 0; hit < 3; ++hit) light[index()] += 220.0;
    std::normal_distribution<double> gaussian;
    for (std::size_t i = 0; i < light.size(); ++i) {
      const double dark = sensor.dark_adu.empty() ? 0.0 : static_cast<double>(sensor.dark_adu[i]);
      const double count =
          light[i] + dark +
          std::sqrt(std::max(light[i] - 20.0, 0.0) + noise * noise) * gaussian(random_);
      const double limit = format.pixel_type == PixelType::kU8 ? 255.0 : 65535.0;
      const auto value = static_cast<unsigned>(std::clamp(std::round(count), 0.0, limit));
      if (format.pixel_type == PixelType::kU8)
        reinterpret_cast<std::uint8_t*>(frame.data())[i] = static_cast<std::uint8_t>(value);
      else
        reinterpret_cast<std::uint16_t*>(frame.data())[i] = static_cast<std::uint16_t>(value);
    }
    frame.header = {};
    frame.header.sequence = number;
    frame.rows_ready = format.rows;
  }

  int whole(int least, int most) {
    return std::uniform_int_distribution<int>(least, most)(random_);
  }

  Sensor sensor;
  FrameFormat format;

 private:
  double uniform(double least, double most) {
    return std::uniform_real_distribution<double>(least, most)(random_);
  }
  std::size_t index() {
    return static_cast<std::size_t>(whole(0, static_cast<int>(format.pixels()) - 1));
  }

  void place_grid(double angle) {
    LensletGrid& grid = sensor.grid;
    grid.p11 = grid.p22 = pitch_px_ * std::cos(angle);
    grid.p21 = pitch_px_ * std::sin(angle);
    grid.p12 = -grid.p21;
    const double margin = 0.7 * pitch_px_ + 1.0;
    const double along_cols = grid.cols - 1, along_rows = grid.rows - 1;
    format.cols = static_cast<int>(std::abs(grid.p11) * along_cols +
                                   std::abs(grid.p12) * along_rows + 2.0 * margin);
    format.rows = static_cast<int>(std::abs(grid.p21) * along_cols +
                                   std::abs(grid.p22) * along_rows + 2.0 * margin);
    format.pixel_type = whole(0, 1) == 1 ? PixelType::kU8 : PixelType::kU16;
    brightness_ = format.pixel_type == PixelType::kU8 ? 700.0 : 4000.0;
    sensor.frame_rows = format.rows;
    sensor.frame_cols = format.cols;
    grid.origin_x_px =
        0.5 * (format.cols - 1) - 0.5 * (grid.p11 * along_cols + grid.p12 * along_rows);
    grid.origin_y_px =
        0.5 * (format.rows - 1) - 0.5 * (grid.p21 * along_cols + grid.p22 * along_rows);
  }

  void make_lenslets(double angle) {
    const int rows = sensor.grid.rows, cols = sensor.grid.cols;
    // Windows of turned grids are smaller, so that they do not overlap.
    const double turn = std::max(std::abs(std::cos(angle)), std::abs(std::sin(angle)));
    const int side = std::max(5, static_cast<int>(pitch_px_ * std::min(turn, 1.0)));
    sensor.valid = Image<std::uint8_t>(rows, cols, 1);
    sensor.window = Image<Window>(rows, cols);
    sensor.gain_x = sensor.gain_y = Image<float>(rows, cols, 1.0F);
    sensor.flux_adu = Image<float>(rows, cols, static_cast<float>(brightness_));
    sensor.ref_x_px = sensor.ref_y_px = Image<float>(rows, cols);
    for (int r = 0; r < rows; ++r) {
      for (int c = 0; c < cols; ++c) {
        const auto [x, y] = sensor.grid.pixel_from_lenslet(c, r);
        sensor.ref_x_px(r, c) = static_cast<float>(x);
        sensor.ref_y_px(r, c) = static_cast<float>(y);
        sensor.window(r, c) = {static_cast<int>(std::lround(x - 0.5 * (side - 1))),
                               static_cast<int>(std::lround(y - 0.5 * (side - 1))), side, side};
      }
    }
    const bool round = whole(0, 1) == 1;
    const double middle_row = 0.5 * (rows - 1), middle_col = 0.5 * (cols - 1);
    for (int r = 0; r < rows; ++r)
      for (int c = 0; c < cols; ++c)
        if (round && std::hypot((r - middle_row) / rows, (c - middle_col) / cols) > 0.49)
          drop_lenslet(sensor, static_cast<std::size_t>(r * cols + c));
  }

  void make_maps() {
    sensor.dark_adu = sensor.flat = Image<float>(format.rows, format.cols);
    sensor.bad_pixel = Image<std::uint8_t>(format.rows, format.cols);
    for (std::size_t i = 0; i < sensor.flat.size(); ++i) {
      sensor.dark_adu[i] = static_cast<float>(whole(0, 9));
      sensor.flat[i] = static_cast<float>(uniform(0.9, 1.1));
    }
    for (int i = 0; i < 40; ++i) sensor.bad_pixel[index()] = 1;
  }

  void add_spot(Image<double>& light, double x, double y, double electrons) const {
    constexpr double kSigma_px = 1.2;
    const int x0 = static_cast<int>(std::lround(x)), y0 = static_cast<int>(std::lround(y));
    for (int row = std::max(y0 - 5, 0); row <= std::min(y0 + 5, light.rows() - 1); ++row)
      for (int col = std::max(x0 - 5, 0); col <= std::min(x0 + 5, light.cols() - 1); ++col)
        light(row, col) += electrons / (2.0 * std::numbers::pi * kSigma_px * kSigma_px) *
                           std::exp(-0.5 * ((col - x) * (col - x) + (row - y) * (row - y)) /
                                    (kSigma_px * kSigma_px));
  }

  std::mt19937 random_;
  double pitch_px_ = 0.0;
  double brightness_ = 0.0;
};

/// The stages, with what frames teach them.
struct Trial {
  explicit Trial(const Plan& of) : plan(of) {
    if (plan.follower) follower = std::make_unique<WindowFollower>(*plan.follower);
    slot = std::make_unique<FrameSlot>(plan, follower.get());
  }
  void run(FrameBuffer& frame) {
    slot->frame = &frame;
    for (const Stage& stage : kStages) stage.run(plan, *slot);
  }

  const Plan& plan;
  std::unique_ptr<WindowFollower> follower;
  std::unique_ptr<FrameSlot> slot;
};

TEST(StreamedSensors, RandomSensorsGiveTheBitsOfWholeFrames) {
  int streamed_frames = 0, streamed_rows = 0, valid = 0;
  for (unsigned seed = 1; seed <= 36; ++seed) {
    RandomScene scene(seed);
    const Config config = scene.config();
    const Plan plan(scene.sensor, scene.format, config);
    Trial whole(plan), streamed(plan);
    FrameBuffer frame(scene.format);
    for (int number = 0; number < kStreamedFrames; ++number) {
      scene.draw(number, frame);
      whole.run(frame);
      const std::string expected = result_bytes(*whole.slot);
      frame.header.status = kFrameOk;
      streamed.slot->frame = &frame;
      for (int ready = 0; ready < scene.format.rows; ready += scene.whole(1, 20))
        measure_ahead(plan, *streamed.slot, ready);
      streamed_frames += streamed.slot->rows_ahead > 0 ? 1 : 0;
      streamed_rows += streamed.slot->rows_ahead;
      streamed.run(frame);
      ASSERT_TRUE(result_bytes(*streamed.slot) == expected)
          << "seed " << seed << " frame " << number;
      valid += whole.slot->centroids.n_valid;
    }
  }
  // Most frames are measured before they are whole, and most lenslets have a spot.
  EXPECT_GT(streamed_frames, 36 * kStreamedFrames / 2);
  EXPECT_GT(streamed_rows, 4 * 36 * kStreamedFrames);
  EXPECT_GT(valid, 60 * 36 * kStreamedFrames);
}

}  // namespace
}  // namespace curlew
