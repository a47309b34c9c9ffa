#include "service/bench/bench_frames.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>
#include <random>
#include <utility>

namespace curlew {

namespace {

/// The gradient of a few plane waves of phase, which is at most 1 along each axis.
class SmoothWavefront {
 public:
  SmoothWavefront(const BenchCase& which, std::mt19937_64& random) {
    std::uniform_real_distribution<double> phase(0.0, 2.0 * std::numbers::pi);
    for (Wave& wave : waves_) {
      const double direction = phase(random);
      const double wavenumber = 2.0 * std::numbers::pi / (0.5 * (which.rows + which.cols));
      wave = {wavenumber * std::cos(direction), wavenumber * std::sin(direction), phase(random),
              std::cos(direction) / kWaves, std::sin(direction) / kWaves};
    }
  }
  std::pair<double, double> gradient(int row, int col) const {
    double x = 0.0;
    double y = 0.0;
    for (const Wave& wave : waves_) {
      const double cosine = std::cos(wave.kx * col + wave.ky * row + wave.phase);
      x += wave.gx * cosine;
      y += wave.gy * cosine;
    }
    return {x, y};
  }

 private:
  static constexpr int kWaves = 4;
  struct Wave {
    double kx, ky, phase, gx, gy;
  };
  std::array<Wave, kWaves> waves_{};
};

}  // namespace

double bench_spot_sigma_px(const BenchCase& which) {
  return std::clamp(which.window_px / 6.0, 0.9, 2.0);
}

BenchFrame make_bench_frame(const BenchCase& which, BenchSlopes slopes, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  const int p = which.window_px;
  const double sigma = bench_spot_sigma_px(which);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  const SmoothWavefront wavefront(which, random);

  BenchFrame frame;
  frame.format = bench_format(which, PixelType::kU16);
  frame.pixels = Image<std::uint16_t>(frame.format.rows, frame.format.cols);
  frame.true_dx_px = Image<float>(which.rows, which.cols);
  frame.true_dy_px = Image<float>(which.rows, which.cols);
  for (int r = 0; r < which.rows; ++r) {
    for (int c = 0; c < which.cols; ++c) {
      const auto [x1, y1] = slopes == BenchSlopes::kSmooth
                                ? wavefront.gradient(r, c)
                                : std::pair{uniform(random), uniform(random)};
      const double dx = x1 * p / 8.0;
      const double dy = y1 * p / 8.0;
      const double peak = std::min(2000.0 * std::exp(0.5 * normal(random)), 30000.0);
      frame.true_dx_px(r, c) = static_cast<float>(dx);
      frame.true_dy_px(r, c) = static_cast<float>(dy);
      for (int y = 0; y < p; ++y) {
        for (int x = 0; x < p; ++x) {
          const double u = x - 0.5 * (p - 1) - dx;
          const double v = y - 0.5 * (p - 1) - dy;
          const double light = peak * std::exp(-(u * u + v * v) / (2.0 * sigma * sigma));
          const double adu = kBenchBackgroundAdu + light + kBenchNoiseAdu * normal(random);
          frame.pixels(r * p + y, c * p + x) =
              static_cast<std::uint16_t>(std::lround(std::clamp(adu, 0.0, 65535.0)));
        }
      }
    }
  }
  return frame;
}

FrameFormat bench_format(const BenchCase& which, PixelType pixel_type) {
  constexpr double kAduPerCountOfU8 = 16.0;
  FrameFormat format;
  format.rows = which.rows * which.window_px;
  format.cols = which.cols * which.window_px;
  format.pixel_type = pixel_type;
  if (pixel_type == PixelType::kU8) format.scale_adu = kAduPerCountOfU8;
  return format;
}

AlignedVector<std::byte> bench_pixels(const BenchFrame& frame, const FrameFormat& format) {
  AlignedVector<std::byte> bytes(format.bytes());
  if (format.pixel_type == PixelType::kU16) {
    std::memcpy(bytes.data(), frame.pixels.data(), bytes.size());
    return bytes;
  }
  std::transform(frame.pixels.begin(), frame.pixels.end(), bytes.begin(), [&](std::uint16_t adu) {
    const double count = std::round(adu / format.scale_adu);
    return static_cast<std::byte>(static_cast<std::uint8_t>(std::min(count, 255.0)));
  });
  return bytes;
}

Sensor tiled_sensor(const BenchCase& which) {
  const auto& [rows, cols, p] = which;
  Sensor sensor;
  sensor.optics = {.pitch_m = 150e-6,
                   .focal_m = 5e-3,
                   .pixel_m = 150e-6 / p,
                   .wavelength_m = 633e-9,
                   .magnification = 1.0,
                   .mirrored = false};
  sensor.detector = {
      .e_per_adu = 1.0, .read_noise_e = kBenchNoiseAdu, .saturation_adu = 65535.0, .bit_depth = 16};
  sensor.frame_rows = rows * p;
  sensor.frame_cols = cols * p;
  const double centre = 0.5 * (p - 1);
  sensor.grid = {.rows = rows,
                 .cols = cols,
                 .origin_x_px = centre,
                 .origin_y_px = centre,
                 .p11 = static_cast<double>(p),
                 .p12 = 0.0,
                 .p21 = 0.0,
                 .p22 = static_cast<double>(p)};
  sensor.background_adu = kBenchBackgroundAdu;
  sensor.valid = Image<std::uint8_t>(rows, cols, 1);
  sensor.ref_x_px = Image<float>(rows, cols);
  sensor.ref_y_px = Image<float>(rows, cols);
  sensor.window = Image<Window>(rows, cols);
  sensor.gain_x = Image<float>(rows, cols, 1.0F);
  sensor.gain_y = Image<float>(rows, cols, 1.0F);
  sensor.flux_adu = Image<float>(rows, cols, 1.0F);
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < cols; ++c) {
      sensor.window(r, c) = {c * p, r * p, p, p};
      sensor.ref_x_px(r, c) = static_cast<float>(c * p + centre);
      sensor.ref_y_px(r, c) = static_cast<float>(r * p + centre);
    }
  }
  return sensor;
}

void add_maps(Sensor& sensor, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<float> normal;
  sensor.dark_adu = Image<float>(sensor.frame_rows, sensor.frame_cols);
  sensor.flat = Image<float>(sensor.frame_rows, sensor.frame_cols);
  sensor.bad_pixel = Image<std::uint8_t>(sensor.frame_rows, sensor.frame_cols);
  for (std::size_t i = 0; i < sensor.dark_adu.size(); ++i) {
    sensor.dark_adu[i] = static_cast<float>(sensor.background_adu) + 2.0F * normal(random);
    sensor.flat[i] = 1.0F + 0.02F * normal(random);
    sensor.bad_pixel[i] = random() % 997 == 0 ? 1 : 0;
  }
}

}  // namespace curlew
