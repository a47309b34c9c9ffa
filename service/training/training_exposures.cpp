#include "service/training/training_exposures.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <vector>

#include "core/frame.h"
#include "service/bench/field_light.h"

namespace curlew {
namespace {

constexpr double kBiasAdu = 100.0;
constexpr double kEPerAdu = 0.25;
constexpr double kThresholdNoise = 3.0;  // of the flux, as for the benchmark's centroids
constexpr double kUsualWindow = 3.0;     // λ/w, of the benchmark
constexpr double kUsualSampling = 2.0;

int base_samples(const TrainingField& field) {
  return static_cast<int>(std::lround(field.parameters.samples_per_lambda_w));
}

template <typename T, std::size_t n>
T one_of(const std::array<T, n>& all, RandomStream& random) {
  return all[std::min(static_cast<std::size_t>(random.uniform() * n), n - 1)];
}

/// Says which part of a field is seen, in pixels of the field.
struct Cut {
  int rows, cols, first_row, first_col;
  int window;       ///< of the sensor
  bool neighbours;  ///< light beyond a window falls on the next one
};

/// Returns the windows of the cut, each in the middle of the field's own, side by side.
Image<float> cut_windows(const TrainingField& field, const Cut& cut) {
  const int wide = field.parameters.window_px;
  const int inset = (wide - cut.window) / 2;
  const int around = cut.neighbours ? 1 : 0;
  Image<float> light(cut.rows * cut.window, cut.cols * cut.window);
  for (int y = 0; y < light.rows(); ++y) {
    for (int row = y / cut.window - around; row <= y / cut.window + around; ++row) {
      const int from_row = cut.first_row + row;
      const int i = y - row * cut.window + inset;
      if (from_row < 0 || from_row >= field.parameters.rows || i < 0 || i >= wide) continue;
      for (int x = 0; x < light.cols(); ++x) {
        for (int col = x / cut.window - around; col <= x / cut.window + around; ++col) {
          const int from_col = cut.first_col + col;
          const int j = x - col * cut.window + inset;
          if (from_col < 0 || from_col >= field.parameters.cols || j < 0 || j >= wide) continue;
          light(y, x) += field.light(from_row * wide + i, from_col * wide + j);
        }
      }
    }
  }
  return light;
}

/// Adds up squares of `bin` pixels. Each window's squares begin `x` and `y` pixels from its corner.
Image<float> binned(const Image<float>& light, int window, int bin, int x, int y) {
  const int side = (window - std::max(x, y)) / bin;
  const int rows = light.rows() / window;
  const int cols = light.cols() / window;
  Image<float> sums(rows * side, cols * side);
  for (int i = 0; i < sums.rows(); ++i) {
    for (int j = 0; j < sums.cols(); ++j) {
      const int first_row = i / side * window + y + i % side * bin;
      const int first_col = j / side * window + x + j % side * bin;
      float sum = 0.0F;
      for (int r = first_row; r < first_row + bin; ++r)
        for (int c = first_col; c < first_col + bin; ++c) sum += light(r, c);
      sums(i, j) = sum;
    }
  }
  return sums;
}

/// Says what the optics do to spots. Lengths are in λ/w.
struct DrawnOptics {
  double blur = 0.0;
  double skirt = 0.0;        ///< part of the light that lies in a wide skirt
  double skirt_sigma = 2.0;  ///< σ of the skirt
};

/// Makes the light of a sensor whose pixels are `bin` of the field's.
DrawnSensor see(const TrainingField& field, const Cut& cut, const DrawnOptics& optics, int bin,
                int x, int y) {
  DrawnSensor sensor;
  const int samples = base_samples(field);
  Image<float> light = cut_windows(field, cut);
  if (optics.blur > 0.0) light = blurred(light, optics.blur * samples);
  if (optics.skirt > 0.0) {
    const Image<float> wide = blurred(light, optics.skirt_sigma * samples);
    const auto part = static_cast<float>(optics.skirt);
    for (std::size_t i = 0; i < light.size(); ++i) light[i] += part * (wide[i] - light[i]);
  }
  sensor.light = binned(light, cut.window, bin, x, y);
  sensor.parameters = field.parameters;
  sensor.parameters.rows = cut.rows;
  sensor.parameters.cols = cut.cols;
  sensor.parameters.window_px = (cut.window - std::max(x, y)) / bin;
  sensor.parameters.samples_per_lambda_w = static_cast<double>(samples) / bin;
  sensor.told_blur = optics.blur;
  sensor.first_row = cut.first_row;
  sensor.first_col = cut.first_col;
  const auto reference = [&](int begin) {
    return static_cast<float>((0.5 * (cut.window - 1) - begin - 0.5 * (bin - 1)) / bin);
  };
  sensor.reference_x_px = reference(x);
  sensor.reference_y_px = reference(y);
  sensor.missing = Image<std::uint8_t>(cut.rows, cut.cols);
  return sensor;
}

DrawnOptics draw_optics(RandomStream& random) {
  DrawnOptics optics;
  if (random.uniform() >= 0.3) optics.blur = 0.8 * random.uniform();
  if (random.uniform() < 0.2) {
    optics.skirt = 0.4 * random.uniform();
    optics.skirt_sigma = 1.2 + 1.3 * random.uniform();
  }
  return optics;
}

void scale_lenslet(DrawnSensor& sensor, int row, int col, float factor) {
  const int window = sensor.parameters.window_px;
  for (int i = row * window; i < (row + 1) * window; ++i)
    for (int j = col * window; j < (col + 1) * window; ++j) sensor.light(i, j) *= factor;
}

/// Returns which part of each lenslet a pupil covers that is smaller than the block: a disc, often
/// with a hole in its middle, less the shadow of a straight spider.
Image<float> draw_pupil(int rows, int cols, RandomStream& random) {
  constexpr int kParts = 4;
  const double size = std::max(rows, cols);
  const double x = cols * random.uniform();
  const double y = rows * random.uniform();
  const double radius = size * (0.25 + 0.75 * random.uniform());
  const double hole = random.uniform() < 0.5 ? radius * 0.5 * random.uniform() : 0.0;
  const double direction = std::numbers::pi * random.uniform();
  const double spider = random.uniform() < 0.5 ? 0.1 + 1.2 * random.uniform() : 0.0;  // half width
  Image<float> covered(rows, cols);
  for (int row = 0; row < rows; ++row) {
    for (int col = 0; col < cols; ++col) {
      int lit = 0;
      for (int part = 0; part < kParts * kParts; ++part) {
        const int above = part / kParts;
        const double dx = col + (part % kParts + 0.5) / kParts - 0.5 - x;
        const double dy = row + (above + 0.5) / kParts - 0.5 - y;
        const double r = std::hypot(dx, dy);
        const double off = dx * std::cos(direction) + dy * std::sin(direction);
        lit += r < radius && r >= hole && std::abs(off) >= spider ? 1 : 0;
      }
      covered(row, col) = static_cast<float>(lit) / (kParts * kParts);
    }
  }
  return covered;
}

/// Takes light from lenslets, and marks as missing what is dark without at least half of the
/// lenslets round it being lit.
void shade(const Image<float>& covered, DrawnSensor& sensor) {
  constexpr float kDark = 0.05F;
  for (int row = 0; row < covered.rows(); ++row) {
    for (int col = 0; col < covered.cols(); ++col) {
      scale_lenslet(sensor, row, col, covered(row, col));
      if (covered(row, col) >= kDark) continue;
      int around = 0;
      int lit = 0;
      for (int i = row - 1; i <= row + 1; ++i) {
        for (int j = col - 1; j <= col + 1; ++j) {
          if (!covered.contains(i, j)) continue;
          ++around;
          lit += covered(i, j) >= kDark ? 1 : 0;
        }
      }
      sensor.missing(row, col) = 2 * lit < around - 1 ? 1 : 0;
    }
  }
}

/// Makes lenslets unequally bright, as scintillation does.
void scintillate(double rms, DrawnSensor& sensor, RandomStream& random) {
  const int rows = sensor.parameters.rows;
  const int cols = sensor.parameters.cols;
  Image<float> white(rows + 1, cols + 1);
  for (float& value : white) value = static_cast<float>(rms * random.gaussian());
  for (int row = 0; row < rows; ++row) {
    for (int col = 0; col < cols; ++col) {
      const float sum =
          white(row, col) + white(row + 1, col) + white(row, col + 1) + white(row + 1, col + 1);
      scale_lenslet(sensor, row, col, std::exp(std::min(sum, 1.5F)));
    }
  }
}

SpotCamera camera_of(const DrawnSensor& sensor) {
  const FieldParameters& p = sensor.parameters;
  SpotCamera camera;
  camera.windows = Image<SpotWindow>(p.rows, p.cols);
  for (int row = 0; row < p.rows; ++row) {
    for (int col = 0; col < p.cols; ++col) {
      const int x = col * p.window_px;
      const int y = row * p.window_px;
      camera.windows(row, col) = {x,
                                  y,
                                  p.window_px,
                                  p.window_px,
                                  static_cast<float>(x) + sensor.reference_x_px,
                                  static_cast<float>(y) + sensor.reference_y_px};
    }
  }
  camera.pixels_per_lambda_w = p.samples_per_lambda_w;
  camera.background_adu = kBiasAdu;
  camera.blur_lambda_w = sensor.told_blur;
  return camera;
}

/// Adds hits by cosmic rays and the light of a reflection, in electrons.
void add_strange_light(const DrawnSensor& sensor, const DrawnNoise& noise, RandomStream& random,
                       Image<float>& light_e) {
  const int n =
      static_cast<int>(random.poisson(noise.hits * static_cast<double>(sensor.missing.size())));
  for (int i = 0; i < n; ++i) {
    const auto k = static_cast<std::size_t>(random.uniform() * static_cast<double>(light_e.size()));
    const double charge_e = 50.0 * std::pow(40.0, random.uniform());
    const double first = random.uniform() < 0.7 ? 1.0 : random.uniform();
    light_e[k] += static_cast<float>(first * charge_e);
    if (k + 1 < light_e.size()) light_e[k + 1] += static_cast<float>((1.0 - first) * charge_e);
  }
  if (noise.ghost_e <= 0.0) return;
  const double x = light_e.cols() * random.uniform();
  const double y = light_e.rows() * random.uniform();
  const double sigma = sensor.parameters.samples_per_lambda_w * (1.0 + 3.0 * random.uniform());
  for (int i = 0; i < light_e.rows(); ++i) {
    for (int j = 0; j < light_e.cols(); ++j) {
      const double r = std::hypot(j - x, i - y) / sigma;
      light_e(i, j) += static_cast<float>(noise.ghost_e * std::exp(-0.5 * r * r));
    }
  }
}

void count_electrons(const DrawnSensor& sensor, const DrawnNoise& noise, RandomStream& random,
                     FrameBuffer& frame, Image<float>& flux_adu) {
  const int window = sensor.parameters.window_px;
  const double threshold_e =
      kThresholdNoise * std::sqrt(noise.read_noise_e * noise.read_noise_e + noise.sky_e);
  Image<float> light_e = sensor.light;
  for (float& value : light_e) value *= static_cast<float>(noise.photons);
  add_strange_light(sensor, noise, random, light_e);
  auto* counts = reinterpret_cast<std::uint16_t*>(frame.data());
  const double common_e = noise.level_error_e * random.gaussian();
  for (int row = 0; row < flux_adu.rows(); ++row) {
    for (int col = 0; col < flux_adu.cols(); ++col) {
      const double level_e = noise.sky_e + common_e + 0.5 * noise.level_error_e * random.gaussian();
      double flux = 0.0;
      for (int i = row * window; i < (row + 1) * window; ++i) {
        for (int j = col * window; j < (col + 1) * window; ++j) {
          const double electrons =
              random.poisson(static_cast<double>(light_e(i, j)) + noise.sky_e) +
              noise.read_noise_e * random.gaussian() - level_e;
          flux += std::max(electrons - threshold_e, 0.0) / kEPerAdu;
          counts[i * light_e.cols() + j] = static_cast<std::uint16_t>(
              std::clamp(std::floor(kBiasAdu + electrons / kEPerAdu + 0.5), 0.0, 65535.0));
        }
      }
      flux_adu(row, col) = static_cast<float>(flux);
    }
  }
}

/// Makes counts without noise. Each window reaches the top of the range; fluxes have no unit.
void count_light(const DrawnSensor& sensor, FrameBuffer& frame, Image<float>& flux_adu) {
  constexpr float kPeakAdu = 60000.0F;
  const int window = sensor.parameters.window_px;
  auto* counts = reinterpret_cast<std::uint16_t*>(frame.data());
  for (int row = 0; row < flux_adu.rows(); ++row) {
    for (int col = 0; col < flux_adu.cols(); ++col) {
      float flux = 0.0F;
      float peak = 0.0F;
      const auto for_each_pixel = [&](auto&& use) {
        for (int i = row * window; i < (row + 1) * window; ++i)
          for (int j = col * window; j < (col + 1) * window; ++j) use(i, j, sensor.light(i, j));
      };
      for_each_pixel([&](int, int, float light) {
        flux += light;
        peak = std::max(peak, light);
      });
      const float scale = peak > 0.0F ? kPeakAdu / peak : 0.0F;
      for_each_pixel([&](int i, int j, float light) {
        counts[i * sensor.light.cols() + j] =
            static_cast<std::uint16_t>(std::lround(kBiasAdu + static_cast<double>(light * scale)));
      });
      flux_adu(row, col) = flux;
    }
  }
}

}  // namespace

DrawnSensor plain_sensor(const TrainingField& field, bool coarse) {
  const FieldParameters& p = field.parameters;
  const int samples = base_samples(field);
  const int usual = std::min(static_cast<int>(kUsualWindow * samples), p.window_px);
  const Cut cut{p.rows, p.cols, 0, 0, coarse ? p.window_px : usual, false};
  return see(field, cut, {}, coarse ? samples : static_cast<int>(samples / kUsualSampling), 0, 0);
}

DrawnSensor draw_sensor(const TrainingField& field, RandomStream& random) {
  const FieldParameters& p = field.parameters;
  const int samples = base_samples(field);
  Cut cut{};
  cut.rows = std::min(kBlockLenslets, p.rows);
  cut.cols = std::min(kBlockLenslets, p.cols);
  cut.first_row = static_cast<int>(random.uniform() * (p.rows - cut.rows + 1));
  cut.first_col = static_cast<int>(random.uniform() * (p.cols - cut.cols + 1));
  cut.window = std::min(static_cast<int>(kUsualWindow * samples), p.window_px);
  if (random.uniform() < 0.45)
    return see(field, cut, {}, static_cast<int>(samples / kUsualSampling), 0, 0);
  constexpr std::array<int, 6> kWindows{2, 3, 3, 4, 4, 6};  // λ/w
  constexpr std::array<int, 8> kBins{1, 2, 2, 2, 3, 4, 4, 5};
  constexpr int kFewestPixels = 3;  // along a window's side
  cut.window = std::min(one_of(kWindows, random) * samples, p.window_px);
  cut.neighbours = cut.window < p.window_px && random.uniform() < 0.5;
  const DrawnOptics optics = draw_optics(random);
  int bin = one_of(kBins, random);
  while ((cut.window - (bin - 1)) / bin < kFewestPixels) --bin;
  const auto begin = [&] {
    return random.uniform() < 0.3 ? 0 : static_cast<int>(random.uniform() * bin);
  };
  const int x = begin();
  DrawnSensor sensor = see(field, cut, optics, bin, x, begin());
  sensor.usual = false;
  // What is known of the blur is not exact.
  constexpr double kVarianceError = 0.015;  // (λ/w)²
  sensor.told_blur =
      std::sqrt(std::max(optics.blur * optics.blur + kVarianceError * random.gaussian(), 0.0));
  const double kind = random.uniform();
  if (kind < 0.25) {
    shade(draw_pupil(cut.rows, cut.cols, random), sensor);
  } else if (kind < 0.55) {
    const double faded = 0.12 * random.uniform() * random.uniform();
    Image<float> covered(cut.rows, cut.cols, 1.0F);
    for (float& part : covered)
      if (random.uniform() < faded) part = random.uniform() < 0.8 ? 0.0F : 0.3F;
    shade(covered, sensor);
  } else if (kind < 0.7) {
    scintillate(0.1 + 0.4 * random.uniform(), sensor, random);
  }
  return sensor;
}

DrawnNoise draw_noise(bool usual, RandomStream& random) {
  DrawnNoise noise;
  if (random.uniform() < 0.2) return noise;
  if (usual) {
    noise.photons = 130.0 * std::pow(10.0, 1.4 * random.uniform());
    return noise;
  }
  noise.photons = 60.0 * std::pow(80.0, random.uniform());
  noise.read_noise_e = random.uniform() < 0.5 ? 1.0 : 0.5 * std::pow(12.0, random.uniform());
  if (random.uniform() < 0.3) noise.sky_e = 20.0 * random.uniform() * random.uniform();
  const double noise_e = std::sqrt(noise.read_noise_e * noise.read_noise_e + noise.sky_e);
  if (random.uniform() < 0.5) noise.level_error_e = 0.12 * noise_e * random.uniform();
  if (random.uniform() < 0.15) noise.hits = 0.03 * random.uniform();
  if (random.uniform() < 0.08) noise.ghost_e = 100.0 * random.uniform();
  return noise;
}

void expose(const DrawnSensor& sensor, const DrawnNoise& noise, RandomStream& random,
            Exposure& exposure) {
  const FieldParameters& p = sensor.parameters;
  FrameFormat format;
  format.rows = p.rows * p.window_px;
  format.cols = p.cols * p.window_px;
  FrameBuffer frame(format);
  Image<float> flux(p.rows, p.cols);
  SpotCamera camera = camera_of(sensor);
  if (std::isfinite(noise.photons)) {
    count_electrons(sensor, noise, random, frame, flux);
    camera.e_per_adu = kEPerAdu;
    camera.read_noise_e = std::sqrt(noise.read_noise_e * noise.read_noise_e + noise.sky_e);
  } else {
    count_light(sensor, frame, flux);
  }
  const SpotFeatures features(camera, format);
  double mean = 0.0;
  double lit = 0.0;
  for (std::size_t k = 0; k < flux.size(); ++k) {
    if (sensor.missing[k] != 0) continue;
    mean += static_cast<double>(flux[k]);
    lit += 1.0;
  }
  mean /= std::max(lit, 1.0);
  exposure.first_row = sensor.first_row;
  exposure.first_col = sensor.first_col;
  exposure.traits = traits_of(camera);
  exposure.missing = sensor.missing;
  exposure.features = Image<float>(p.rows, p.cols * kSpotFeatures);
  for (std::size_t k = 0; k < flux.size(); ++k) {
    features.measure(frame.view(), {}, k, flux[k], static_cast<float>(mean),
                     exposure.features.data() + k * kSpotFeatures);
  }
}

}  // namespace curlew
