#include "detect/classifier/spot_features.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "acquisition/simulator/random_stream.h"
#include "service/spot_camera.h"

namespace curlew {
namespace {

constexpr std::uint64_t kFeatureSeed = 20260731;

/// Returns windows of every size that fill a frame of 96 × 97 pixels to its last one. Their
/// references are off the pixels' centres, and one lenslet is missing.
SpotCamera camera_of_test(double pixels_per_lambda_w) {
  constexpr std::array<int, 8> kSides{4, 6, 7, 8, 9, 12, 20, 30};
  SpotCamera camera;
  camera.windows = Image<SpotWindow>(kSides.size(), kSides.size());
  int y = 0;
  for (int row = 0; row < camera.windows.rows(); ++row) {
    const int h = kSides[static_cast<std::size_t>(row)];
    int x = 1;
    for (int col = 0; col < camera.windows.cols(); ++col) {
      const int w = kSides[static_cast<std::size_t>(col)];
      camera.windows(row, col) = {x,
                                  y,
                                  w,
                                  h,
                                  static_cast<float>(x) + 0.5F * static_cast<float>(w) - 0.31F,
                                  static_cast<float>(y) + 0.5F * static_cast<float>(h) - 0.77F};
      x += w;
    }
    y += h;
  }
  camera.windows(2, 3) = {};
  camera.pixels_per_lambda_w = pixels_per_lambda_w;
  camera.rows_run_up = true;
  camera.background_adu = 100.0;
  camera.e_per_adu = 0.25;
  camera.read_noise_e = 1.0;
  return camera;
}

FrameFormat format_of_test(PixelType type) {
  FrameFormat format;
  format.rows = 96;
  format.cols = 97;
  format.pixel_type = type;
  return format;
}

void expect_many_equal_one(const SpotCamera& camera, PixelType type, const FrameShift& shift = {}) {
  const FrameFormat format = format_of_test(type);
  const SpotFeatures features(camera, format);
  RandomStream random(kFeatureSeed, 0);
  FrameBuffer frame(format);
  for (std::size_t i = 0; i < format.pixels(); ++i) {
    const double count = 100.0 + 100.0 * random.uniform();
    if (type == PixelType::kU16) {
      reinterpret_cast<std::uint16_t*>(frame.data())[i] = static_cast<std::uint16_t>(count * 50.0);
    } else {
      reinterpret_cast<std::uint8_t*>(frame.data())[i] = static_cast<std::uint8_t>(count);
    }
  }
  std::vector<std::int32_t> lenslets;
  std::vector<float> flux;
  for (std::size_t k = 0; k < features.lenslet_count(); ++k) {
    flux.push_back(static_cast<float>(1000.0 * random.uniform()));
    lenslets.push_back(static_cast<std::int32_t>(k));  // Missing ones are included.
  }
  ASSERT_EQ(lenslets.size(), 64U);
  std::vector<float> many(lenslets.size() * kSpotFeatures + kProjectionSlack);
  features.measure_many(frame.view(), shift, lenslets.data(), static_cast<int>(lenslets.size()),
                        flux.data(), 500.0F, many.data());
  std::array<float, kSpotFeatures> one{};
  for (std::size_t i = 0; i < lenslets.size(); ++i) {
    const auto k = static_cast<std::size_t>(lenslets[i]);
    features.measure(frame.view(), shift, k, flux[k], 500.0F, one.data());
    for (std::size_t f = 0; f < kSpotFeatures; ++f) {
      // Both are sums of a window's pixels, all positive, over the sum of these. They differ by a
      // few roundings of 1.
      EXPECT_NEAR(many[i * kSpotFeatures + static_cast<std::size_t>(kMeasuredPlaces[f])], one[f],
                  3e-6F * std::max(1.0F, std::abs(one[f])))
          << "lenslet " << k << ", feature " << f << ", seed " << kFeatureSeed;
    }
  }
}

TEST(SpotFeatures, ManyAreAsOne) {
  for (const double scale : {2.0, 3.0, 9.0}) {
    expect_many_equal_one(camera_of_test(scale), PixelType::kU16);
    expect_many_equal_one(camera_of_test(scale), PixelType::kU8);
  }
}

TEST(SpotFeatures, ManyAreAsOneWithDarkAndResponse) {
  SpotCamera camera = camera_of_test(3.0);
  RandomStream random(kFeatureSeed, 1);
  camera.dark_adu = Image<float>(96, 97);
  camera.response = Image<float>(96, 97);
  for (std::size_t i = 0; i < camera.dark_adu.size(); ++i) {
    camera.dark_adu[i] = static_cast<float>(90.0 * random.uniform());
    camera.response[i] = static_cast<float>(random.uniform() < 0.05 ? 0.0 : 0.5 + random.uniform());
  }
  expect_many_equal_one(camera, PixelType::kU16);
}

/// Maps of a frame whose level, noise and windows are not those of the calibration. Some windows
/// partly leave the frame.
struct ShiftedFrame {
  ShiftedFrame() {
    RandomStream random(kFeatureSeed, 2);
    for (std::size_t k = 0; k < level.size(); ++k) {
      level[k] = static_cast<float>(20.0 * random.uniform());
      spots_x[k] = static_cast<float>(30.0 * (random.uniform() - 0.5));
      spots_y[k] = static_cast<float>(30.0 * (random.uniform() - 0.5));
      windows_x[k] = std::round(spots_x[k]);
      windows_y[k] = std::round(spots_y[k]);
    }
  }
  FrameShift shift() const {
    return {.level_counts = &level,
            .noise_counts = 9.0F,
            .spots_x_px = &spots_x,
            .spots_y_px = &spots_y,
            .windows_x_px = &windows_x,
            .windows_y_px = &windows_y};
  }

  Image<float> level{8, 8};
  Image<float> spots_x{8, 8};
  Image<float> spots_y{8, 8};
  Image<float> windows_x{8, 8};
  Image<float> windows_y{8, 8};
};

TEST(SpotFeatures, ManyAreAsOneInAFrameThatIsNotAsCalibrated) {
  const ShiftedFrame shifted;
  SpotCamera camera = camera_of_test(3.0);
  expect_many_equal_one(camera, PixelType::kU16, shifted.shift());
  camera.response = Image<float>(96, 97, 1.0F);
  for (std::size_t i = 0; i < camera.response.size(); i += 23) camera.response[i] = 0.0F;
  expect_many_equal_one(camera, PixelType::kU8, shifted.shift());
}

/// A spot at level 60 in a window that has moved by (3, −2) pixels gives what it gave at level 0
/// where the window was.
TEST(SpotFeatures, LevelAndMovedWindowsDoNotShow) {
  constexpr int kSide = 32;
  constexpr float kLevel = 60.0F;
  FrameFormat format;
  format.rows = format.cols = kSide;
  SpotCamera camera;
  camera.windows = Image<SpotWindow>(1, 1);
  camera.windows(0, 0) = {8, 10, 9, 9, 12.3F, 13.6F};
  camera.pixels_per_lambda_w = 3.0;
  camera.background_adu = 100.0;
  camera.e_per_adu = 1.0;
  camera.read_noise_e = 2.0;
  const SpotFeatures features(camera, format);
  const auto measured = [&](float level, int dx, int dy, const FrameShift& shift) {
    FrameBuffer frame(format);
    auto* counts = reinterpret_cast<std::uint16_t*>(frame.data());
    for (int y = 0; y < kSide; ++y) {
      for (int x = 0; x < kSide; ++x) {
        const float u = static_cast<float>(x - dx) - 12.0F;
        const float v = static_cast<float>(y - dy) - 14.0F;
        const float spot = std::round(900.0F * std::exp(-0.2F * (u * u + v * v)));
        counts[y * kSide + x] = static_cast<std::uint16_t>(100.0F + level + spot);
      }
    }
    std::array<float, kSpotFeatures> spot{};
    features.measure(frame.view(), shift, 0, 500.0F, 500.0F, spot.data());
    return spot;
  };
  const Image<float> level(1, 1, kLevel), x(1, 1, 3.0F), y(1, 1, -2.0F);
  const auto calibrated = measured(0.0F, 0, 0, {});
  const auto moved = measured(kLevel, 3, -2,
                              {.level_counts = &level,
                               .noise_counts = 2.0F,
                               .spots_x_px = &x,
                               .spots_y_px = &y,
                               .windows_x_px = &x,
                               .windows_y_px = &y});
  for (std::size_t i = 0; i < kSpotFeatures; ++i) EXPECT_NEAR(moved[i], calibrated[i], 1e-5F) << i;
}

TEST(SpotFeatures, EveryPlaceIsTakenOnce) {
  std::vector<bool> taken(kSpotFeatures, false);
  for (const int place : kMeasuredPlaces) {
    ASSERT_GE(place, 0);
    ASSERT_LT(place, kSpotFeatures);
    EXPECT_FALSE(taken[static_cast<std::size_t>(place)]);
    taken[static_cast<std::size_t>(place)] = true;
  }
}

}  // namespace
}  // namespace curlew
