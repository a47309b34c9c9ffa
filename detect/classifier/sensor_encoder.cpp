#include "detect/classifier/sensor_encoder.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace curlew {
namespace {

constexpr double kUsualPixel = 0.5;  // λ/w, of the benchmark
constexpr double kUsualReach = 1.5;

double factorial(int n) { return std::tgamma(n + 1.0); }

/// Returns the coefficients of (a·X + b·Y)^p · (c·X + d·Y)^q by the power of X.
std::array<double, kHighestOrder + 1> product_of_powers(double a, double b, int p, double c,
                                                        double d, int q) {
  std::array<double, kHighestOrder + 1> product{1.0};
  for (int i = 0; i < p + q; ++i) {
    const double of_x = i < p ? a : c;
    const double of_y = i < p ? b : d;
    for (auto power = static_cast<std::size_t>(i) + 1; power > 0; --power)
      product[power] = of_y * product[power] + of_x * product[power - 1];
    product[0] *= of_y;
  }
  return product;
}

}  // namespace

SensorTraits traits_of(const SpotCamera& camera) {
  SensorTraits traits;
  traits.blur = camera.blur_lambda_w;
  traits.pixel = 1.0 / camera.pixels_per_lambda_w;
  int side = 0;
  for (const SpotWindow& window : camera.windows)
    side = std::max(side, std::min(window.w, window.h));
  traits.reach = std::min(kModeReach, 0.5 * side * traits.pixel);
  return traits;
}

std::array<float, kTraitBlocks> trait_factors(const SensorTraits& traits) {
  // A pixel of side p blurs as a Gaussian of variance p²/12 does.
  const double variance =
      traits.blur * traits.blur +
      std::max(traits.pixel * traits.pixel - kUsualPixel * kUsualPixel, 0.0) / 12.0;
  return {1.0F, static_cast<float>(2.0 * std::sqrt(variance)), static_cast<float>(4.0 * variance),
          static_cast<float>(2.0 * std::max(traits.pixel - kUsualPixel, 0.0))};
}

float reach_input(const SensorTraits& traits) {
  return static_cast<float>(traits.reach - kUsualReach);
}

float excess_spread(const SensorTraits& traits) {
  return static_cast<float>(2.0 * traits.blur * traits.blur +
                            (traits.pixel * traits.pixel - kUsualPixel * kUsualPixel) / 6.0);
}

// Hermite functions are the states of an oscillator: h_m(x)·h_n(y) is A^m B^n / √(m! n!) of the
// ground state, where A and B are the raising operators along x and y. Along turned axes the
// operators are cos·A + sin·B and cos·B − sin·A, and multiplying out gives T.
std::array<std::array<double, kSpotModes>, kSpotModes> turned_modes(double angle_rad) {
  std::array<std::array<double, kSpotModes>, kSpotModes> turned{};
  const double c = std::cos(angle_rad);
  const double s = std::sin(angle_rad);
  for (int i = 0; i < kSpotModes; ++i) {
    const auto [m, n] = spot_mode(i);
    const auto product = product_of_powers(c, s, m, -s, c, n);
    for (int power = 0; power <= m + n; ++power) {
      const int rest = m + n - power;
      const auto from = static_cast<std::size_t>(spot_mode_index({power, rest}));
      turned[static_cast<std::size_t>(i)][from] =
          product[static_cast<std::size_t>(power)] *
          std::sqrt(factorial(power) * factorial(rest) / (factorial(m) * factorial(n)));
    }
  }
  return turned;
}

DenseLayer layer_for_sensor(const DenseLayer& taught, const SensorTraits& traits,
                            double rotation_rad) {
  DenseLayer layer(kSpotFeatures, taught.outputs);
  const auto outputs = static_cast<std::size_t>(taught.outputs);
  layer.bias = taught.bias;
  AlignedVector<float> weights(layer.weights.size());
  const auto factors = trait_factors(traits);
  for (std::size_t block = 0; block < factors.size(); ++block) {
    const float* from = taught.weights.data() + block * weights.size();
    for (std::size_t i = 0; i < weights.size(); ++i) weights[i] += factors[block] * from[i];
  }
  // The last feature is 1 where there is a lenslet.
  const float* of_reach = taught.weights.data() + kTraitBlocks * weights.size();
  for (std::size_t o = 0; o < outputs; ++o)
    weights[(kSpotFeatures - 1) * outputs + o] += reach_input(traits) * of_reach[o];
  std::copy(weights.begin(), weights.end(), layer.weights.begin());
  if (rotation_rad == 0.0) return layer;
  const auto turned = turned_modes(rotation_rad);
  for (std::size_t from = 0; from < kSpotModes; ++from) {
    for (std::size_t o = 0; o < outputs; ++o) {
      double sum = 0.0;
      for (std::size_t i = 0; i < kSpotModes; ++i)
        sum += turned[i][from] * static_cast<double>(weights[i * outputs + o]);
      layer.weights[from * outputs + o] = static_cast<float>(sum);
    }
  }
  return layer;
}

}  // namespace curlew
