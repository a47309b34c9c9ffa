// A sensor of 16 x 16 lenslets, frames of its spots wherever a test wants them, and a
// WindowFollower that follows these frames.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <numbers>

#include "acquisition/simulator/random_stream.h"
#include "centroiding/window_follower.h"

namespace curlew {

inline constexpr std::uint64_t kSceneSeed = 20261129;
inline constexpr int kCount = 16;       // lenslets along a side
inline constexpr double kPitch = 12.0;  // px
inline constexpr double kMargin = 30.0;
inline constexpr double kSigma = 1.5;
inline constexpr double kElectrons = 3000.0;
inline constexpr double kReadNoise = 3.0;
inline constexpr double kBias = 100.0;

using Place = std::array<double, 2>;
/// The displacement of lenslet (row, col)'s spot, in px; and its light over the usual.
using Displacement = std::function<Place(int row, int col)>;
using Brightness = std::function<double(int row, int col)>;

inline Displacement tilt(double x_pitches, double y_pitches) {
  return [=](int, int) { return Place{x_pitches * kPitch, y_pitches * kPitch}; };
}
inline double all_lit(int, int) { return 1.0; }
/// A beam that leaves three lenslets dark on every side.
inline double round_beam(int row, int col) {
  const double middle = 0.5 * (kCount - 1);
  return std::hypot(row - middle, col - middle) < 5.2 ? 1.0 : 0.0;
}

/// A sensor that was calibrated without any error, and frames of it.
struct FollowedScene {
  explicit FollowedScene(double rotation_deg = 0.0, double pitch_px = kPitch,
                         double spot_sigma_px = kSigma)
      : sigma_px(spot_sigma_px) {
    const double a = rotation_deg * std::numbers::pi / 180.0;
    const double side = kCount * pitch_px * (std::abs(std::cos(a)) + std::abs(std::sin(a)));
    const int pixels = static_cast<int>(side + 2.0 * kMargin);
    sensor.frame_rows = format.rows = pixels;
    sensor.frame_cols = format.cols = pixels;
    LensletGrid& grid = sensor.grid;
    grid.rows = grid.cols = kCount;
    grid.p11 = grid.p22 = pitch_px * std::cos(a);
    grid.p21 = pitch_px * std::sin(a);
    grid.p12 = -grid.p21;
    const double middle = 0.5 * (kCount - 1);
    grid.origin_x_px = 0.5 * (pixels - 1) - middle * (grid.p11 + grid.p12);
    grid.origin_y_px = 0.5 * (pixels - 1) - middle * (grid.p21 + grid.p22);
    sensor.detector = {.e_per_adu = 1.0, .read_noise_e = kReadNoise};
    sensor.background_adu = kBias;
    sensor.spot_sharpness = 1.3;
    sensor.valid = Image<std::uint8_t>(kCount, kCount, 1);
    sensor.window = Image<Window>(kCount, kCount);
    sensor.gain_x = sensor.gain_y = Image<float>(kCount, kCount, 1.0F);
    sensor.flux_adu = Image<float>(kCount, kCount, static_cast<float>(kElectrons));
    sensor.ref_x_px = sensor.ref_y_px = Image<float>(kCount, kCount);
    const int window = static_cast<int>(pitch_px);
    for (int r = 0; r < kCount; ++r) {
      for (int c = 0; c < kCount; ++c) {
        const auto [x, y] = grid.pixel_from_lenslet(c, r);
        sensor.ref_x_px(r, c) = static_cast<float>(x);
        sensor.ref_y_px(r, c) = static_cast<float>(y);
        sensor.window(r, c) = {static_cast<int>(std::lround(x - 0.5 * (window - 1))),
                               static_cast<int>(std::lround(y - 0.5 * (window - 1))), window,
                               window};
      }
    }
  }

  Image<std::uint16_t> draw(const Displacement& moved, const Brightness& brightness,
                            std::uint64_t number, double level = 0.0) const {
    RandomStream random(kSceneSeed, number);
    Image<double> light(format.rows, format.cols);
    for (int r = 0; r < kCount; ++r) {
      for (int c = 0; c < kCount; ++c) {
        const auto [dx, dy] = moved(r, c);
        add_spot(light, static_cast<double>(sensor.ref_x_px(r, c)) + dx,
                 static_cast<double>(sensor.ref_y_px(r, c)) + dy, brightness(r, c) * kElectrons);
      }
    }
    Image<std::uint16_t> counts(format.rows, format.cols);
    for (std::size_t i = 0; i < counts.size(); ++i) {
      const double noise = std::sqrt(light[i] + kReadNoise * kReadNoise) * random.gaussian();
      counts[i] =
          static_cast<std::uint16_t>(std::max(0.0, std::round(kBias + level + light[i] + noise)));
    }
    return counts;
  }

  void add_spot(Image<double>& light, double x, double y, double electrons) const {
    const auto part = [this](int pixel, double centre) {
      const double scale = sigma_px * std::numbers::sqrt2;
      return 0.5 *
             (std::erf((pixel + 0.5 - centre) / scale) - std::erf((pixel - 0.5 - centre) / scale));
    };
    const int reach = 10;
    const int x0 = static_cast<int>(std::lround(x)), y0 = static_cast<int>(std::lround(y));
    for (int row = std::max(y0 - reach, 0); row <= std::min(y0 + reach, light.rows() - 1); ++row)
      for (int col = std::max(x0 - reach, 0); col <= std::min(x0 + reach, light.cols() - 1); ++col)
        light(row, col) += electrons * part(row, y) * part(col, x);
  }

  double sigma_px;
  Sensor sensor;
  FrameFormat format;
};

/// Follows the frames of one scene.
struct Following {
  explicit Following(const FollowedScene& of, const CentroidOptions& options = {})
      : scene(of),
        plan(scene.sensor, scene.format, options),
        level_plan(scene.sensor, plan, options),
        sharp_plan(scene.sensor, scene.format),
        follower(scene.sensor, plan, level_plan, options),
        levels(level_plan),
        sharp(kCount, kCount),
        centroids(kCount, kCount) {}

  FollowState see(const Displacement& moved, const Brightness& brightness = all_lit,
                  double level = 0.0) {
    counts = scene.draw(moved, brightness, ++frames, level);
    return measure();
  }
  FollowState measure() {
    return follower.measure(plan, level_plan, sharp_plan, view(), levels, sharp, centroids);
  }
  int measure_ahead(int ready) {
    return follower.measure_ahead(plan, level_plan, sharp_plan, view(), ready, levels, sharp,
                                  centroids);
  }
  FrameView view() const {
    return {.pixels = reinterpret_cast<const std::byte*>(counts.data()),
            .rows = counts.rows(),
            .cols = counts.cols(),
            .pixel_type = PixelType::kU16};
  }

  /// The largest mean error along an axis, px, and how many spots are more than .5 px off.
  struct Errors {
    double mean_px = 0.0;
    int wrong = 0;
  };
  Errors errors(const Displacement& moved) const {
    Errors errors;
    double x = 0.0, y = 0.0;
    for (int r = 0; r < kCount; ++r) {
      for (int c = 0; c < kCount; ++c) {
        if (centroids.state(r, c) != LensletState::kValid) continue;
        const auto [dx, dy] = moved(r, c);
        const double ex = static_cast<double>(centroids.x_px(r, c) - scene.sensor.ref_x_px(r, c));
        const double ey = static_cast<double>(centroids.y_px(r, c) - scene.sensor.ref_y_px(r, c));
        x += ex - dx;
        y += ey - dy;
        errors.wrong += std::hypot(ex - dx, ey - dy) > 0.5 ? 1 : 0;
      }
    }
    if (centroids.n_valid > 0)
      errors.mean_px = std::max(std::abs(x), std::abs(y)) / centroids.n_valid;
    return errors;
  }

  const FollowedScene& scene;
  CentroidPlan plan;
  LevelPlan level_plan;
  SharpPixelPlan sharp_plan;
  WindowFollower follower;
  FrameLevels levels;
  SharpPixels sharp;
  Centroids centroids;
  Image<std::uint16_t> counts;
  std::uint64_t frames = 0;
};

}  // namespace curlew
