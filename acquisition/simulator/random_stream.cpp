#include "acquisition/simulator/random_stream.h"

#include <bit>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace curlew {
namespace {

// Makes a step of SplitMix64, which is also a good mixer of seed and stream number.
std::uint64_t split_mix(std::uint64_t& state) {
  state += 0x9e3779b97f4a7c15U;
  std::uint64_t z = state;
  z = (z ^ (z >> 30U)) * 0xbf58476d1ce4e5b9U;
  z = (z ^ (z >> 27U)) * 0x94d049bb133111ebU;
  return z ^ (z >> 31U);
}

double bell(double x) { return std::exp(-0.5 * x * x); }

// Holds the layers of the ziggurat: layer i reaches from 0 to x[i], and its top is bell(x[i + 1]).
struct Ziggurat {
  static constexpr std::size_t kLayers = 256;
  static constexpr double kTail = 3.6541528853610088;  // where 256 layers of equal area end

  std::array<double, kLayers + 1> x{};
  std::array<double, kLayers + 1> height{};

  Ziggurat() {
    const double tail_area =
        std::sqrt(std::numbers::pi / 2.0) * std::erfc(kTail / std::numbers::sqrt2);
    const double area = kTail * bell(kTail) + tail_area;
    x[0] = area / bell(kTail);
    x[1] = kTail;
    for (std::size_t i = 2; i < kLayers; ++i) {
      x[i] = std::sqrt(-2.0 * std::log(area / x[i - 1] + bell(x[i - 1])));
    }
    x[kLayers] = 0.0;
    for (std::size_t i = 0; i <= kLayers; ++i) height[i] = bell(x[i]);
  }
};

const Ziggurat kZiggurat;

// The reciprocals 1/k are made beforehand, because a division per step would be most of the
// inversion's cost.
constexpr std::size_t kReciprocals = 128;
constexpr std::array<double, kReciprocals> make_reciprocals() {
  std::array<double, kReciprocals> r{};
  for (std::size_t k = 1; k < kReciprocals; ++k) r[k] = 1.0 / static_cast<double>(k);
  return r;
}
constexpr std::array<double, kReciprocals> kReciprocal = make_reciprocals();

// Returns ln k!, by a product for small k, else by Stirling's series, whose next term is under 1e-9
// there.
double log_factorial(double k) {
  if (k < 12.0) {
    double product = 1.0;
    for (int i = 2; i <= static_cast<int>(k); ++i) product *= i;
    return std::log(product);
  }
  const double r = 1.0 / k;
  return (k + 0.5) * std::log(k) - k + 0.5 * std::log(2.0 * std::numbers::pi) +
         r * (1.0 / 12.0 - r * r * (1.0 / 360.0 - r * r / 1260.0));
}

}  // namespace

RandomStream::RandomStream(std::uint64_t seed, std::uint64_t stream) noexcept {
  std::uint64_t mixed_seed = seed;
  std::uint64_t mixer = split_mix(mixed_seed) ^ (stream * 0xd1342543de82ef95U);
  for (auto& word : state_) word = split_mix(mixer);
}

std::uint64_t RandomStream::bits() noexcept {
  const std::uint64_t result = std::rotl(state_[0] + state_[3], 23) + state_[0];
  const std::uint64_t shifted = state_[1] << 17U;
  state_[2] ^= state_[0];
  state_[3] ^= state_[1];
  state_[1] ^= state_[2];
  state_[0] ^= state_[3];
  state_[2] ^= shifted;
  state_[3] = std::rotl(state_[3], 45);
  return result;
}

double RandomStream::uniform() noexcept {
  return (static_cast<double>(bits() >> 11U) + 0.5) * 0x1p-53;
}

double RandomStream::gaussian() noexcept {
  while (true) {
    const std::uint64_t random = bits();
    const auto layer = static_cast<std::size_t>(random & 255U);  // These bits are not used by u.
    const double u = (static_cast<double>(random >> 11U) + 0.5) * 0x1p-52 - 1.0;
    const double x = u * kZiggurat.x[layer];
    if (std::abs(x) < kZiggurat.x[layer + 1]) return x;
    if (layer == 0) {  // This is Marsaglia's tail.
      double beyond = 0.0;
      double test = 0.0;
      do {
        beyond = -std::log(uniform()) / Ziggurat::kTail;
        test = -std::log(uniform());
      } while (2.0 * test < beyond * beyond);
      return u < 0.0 ? -(Ziggurat::kTail + beyond) : Ziggurat::kTail + beyond;
    }
    const double low = kZiggurat.height[layer];
    const double high = kZiggurat.height[layer + 1];
    if (low + (high - low) * uniform() < bell(x)) return x;
  }
}

double RandomStream::poisson(double mean) noexcept {
  if (!(mean > 0.0)) return 0.0;
  if (mean >= kInversionMean) return poisson_by_rejection(mean);
  double left = uniform();
  double probability = std::exp(-mean);
  std::size_t k = 0;
  while (left > probability && k + 1 < kReciprocals) {
    left -= probability;
    ++k;
    probability *= mean * kReciprocal[k];
  }
  return static_cast<double>(k);
}

double RandomStream::poisson_by_rejection(double mean) noexcept {
  // Names and numbers are Hörmann's.
  const double b = 0.931 + 2.53 * std::sqrt(mean);
  const double a = -0.059 + 0.02483 * b;
  const double v_r = 0.9277 - 3.6224 / (b - 2.0);
  while (true) {
    const double u = uniform() - 0.5;
    const double v = uniform();
    const double u_s = 0.5 - std::abs(u);
    const double k = std::floor((2.0 * a / u_s + b) * u + mean + 0.43);
    if (u_s >= 0.07 && v <= v_r) return k;
    if (k < 0.0 || (u_s < 0.013 && v > u_s)) continue;
    const double inverse_alpha = 1.1239 + 1.1328 / (b - 3.4);
    if (std::log(v * inverse_alpha / (a / (u_s * u_s) + b)) <=
        k * std::log(mean) - mean - log_factorial(k)) {
      return k;
    }
  }
}

}  // namespace curlew
