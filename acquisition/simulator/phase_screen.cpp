#include "acquisition/simulator/phase_screen.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace curlew {
namespace {

using Complex = std::complex<double>;

constexpr double kTwoPi = 2.0 * std::numbers::pi;
constexpr std::uint64_t kScreenSeed = 0x7572624c65636e65U;  // It keeps screens apart from noise.
constexpr int kSteep = 8;               // frequencies over whose cells the spectrum is steep
constexpr int kLinesPerPair = 1 << 14;  // random streams, one for each line of the spectrum

// Returns 0, −1, 1, −2, 2 … for q = 0, 1, 2 …, so that finer grids only append frequencies.
int zigzag(int q) { return q % 2 == 0 ? q / 2 : -(q + 1) / 2; }

// Returns the variance, rad², that one frequency stands for: what its cell of frequencies has of f²
// times the spectrum, over its own f², so that the slopes it makes have the right variance. The
// spectrum is too steep near 0 to take its value at the middle: the structure function would be 4
// to 13 % low.
double cell_power(const VonKarman& spectrum, double fx, double fy, double width) {
  constexpr int kPoints = 16;
  double sum = 0.0;
  for (int i = 0; i < kPoints; ++i) {
    for (int j = 0; j < kPoints; ++j) {
      const double f = std::hypot(fx + width * ((j + 0.5) / kPoints - 0.5),
                                  fy + width * ((i + 0.5) / kPoints - 0.5));
      sum += f * f * spectrum(f);
    }
  }
  return sum / (kPoints * kPoints) / (fx * fx + fy * fy) * width * width;
}

// Returns exp(−2πi k·shift/width) for k = 0 … n−1, where those from n/2 on are negative
// frequencies.
std::vector<std::complex<float>> shift_factors(int n, double shift_of_width) {
  std::vector<std::complex<float>> factors(static_cast<std::size_t>(n));
  for (int k = 0; k < n; ++k) {
    const int frequency = k < n / 2 ? k : k - n;
    factors[static_cast<std::size_t>(k)] =
        std::complex<float>(std::polar(1.0, -kTwoPi * std::fmod(frequency * shift_of_width, 1.0)));
  }
  return factors;
}

}  // namespace

double VonKarman::operator()(double frequency) const {
  const double constant = std::pow(24.0 / 5.0 * std::tgamma(6.0 / 5.0), 5.0 / 6.0) *
                          std::pow(std::tgamma(11.0 / 6.0), 2) /
                          (2.0 * std::pow(std::numbers::pi, 11.0 / 3.0));
  const double inner = kTwoPi * frequency * inner_scale / 5.92;
  return constant * std::pow(r0, -5.0 / 3.0) *
         std::pow(frequency * frequency + 1.0 / (outer_scale * outer_scale), -11.0 / 6.0) *
         std::exp(-inner * inner);
}

PhaseScreens::PhaseScreens(int n, double spacing, const VonKarman& spectrum, bool subharmonics,
                           std::uint64_t seed)
    : n_(n), spacing_(spacing), seed_(seed ^ kScreenSeed), amplitude_(n / 2, n / 2) {
  const double step = 1.0 / (n * spacing);  // cycles per unit of length
  for (int i = 0; i < n / 2; ++i) {
    for (int j = 0; j < n / 2; ++j) {
      const double power = i + j > 0 ? spectrum(step * std::hypot(i, j)) : 0.0;
      amplitude_(i, j) = static_cast<float>(std::sqrt(power) * step);
    }
  }
  if (!subharmonics) return;
  for (int i = 0; i < std::min(kSteep, n / 2); ++i) {
    for (int j = 0; j < std::min(kSteep, n / 2); ++j) {
      if (i + j == 0) continue;
      amplitude_(i, j) =
          static_cast<float>(std::sqrt(cell_power(spectrum, step * j, step * i, step)));
    }
  }
  // The levels go down to well below 1/L0, where the spectrum is flat.
  double width = step;
  do {
    width /= 3.0;
    for (int i = -1; i <= 1; ++i) {
      for (int j = -1; j <= 1; ++j) {
        if (i == 0 && j == 0) continue;
        const double power = cell_power(spectrum, j * width, i * width, width);
        slow_.push_back({j * width, i * width, power, levels_});
      }
    }
    ++levels_;
  } while (width * spectrum.outer_scale > 0.3 && levels_ < 20);
  along_x_.resize(3L * levels_, n);
  along_y_.resize(n, 3L * levels_);
  for (const Slow& slow : slow_) {
    if (slow.fx != 0.0 || slow.fy < 0.0) continue;
    const Eigen::Index first = 3L * slow.level;
    for (int i = 0; i < n; ++i) {
      const double angle = kTwoPi * slow.fy * i * spacing;
      along_y_(i, first) = 1.0F;
      along_y_(i, first + 1) = static_cast<float>(std::cos(angle));
      along_y_(i, first + 2) = static_cast<float>(std::sin(angle));
    }
  }
  line_.resize(n);
}

void PhaseScreens::draw(std::int64_t realisation, int pair, const ScreenShift& first,
                        const ScreenShift& second, SquareFft& fft,
                        Image<std::complex<float>>& screens) {
  const auto index = [this](int frequency) { return frequency < 0 ? frequency + n_ : frequency; };
  constexpr std::uint64_t kPairs = 1024;
  const std::uint64_t stream =
      (static_cast<std::uint64_t>(realisation) * kPairs + static_cast<std::uint64_t>(pair)) *
      kLinesPerPair;
  // The spectrum is [x, y], because the transform transposes. The highest frequency, n/2, has no
  // opposite one and is left out.
  screens.fill({});
  for (int p = 0; p < n_ - 1; ++p) {
    const int fx = zigzag(p);
    RandomStream random(seed_, stream + static_cast<std::uint64_t>(p));
    for (int q = 0; q < n_ - 1; ++q) {
      const int fy = zigzag(q);
      const float amplitude = amplitude_(std::abs(fx), std::abs(fy));
      const auto re = static_cast<float>(random.gaussian());
      const auto im = static_cast<float>(random.gaussian());
      screens(index(fx), index(fy)) = {amplitude * re, amplitude * im};
    }
  }
  if (first.x != 0.0 || first.y != 0.0 || second.x != 0.0 || second.y != 0.0) {
    drift(first, second, screens);
  }
  fft.inverse(screens);
  if (!slow_.empty()) {
    RandomStream random(seed_, stream + kLinesPerPair - 1);
    add_subharmonics(random, first, false, screens);
    add_subharmonics(random, second, true, screens);
  }
}

// If c(f) is the spectrum of both screens, that of the first is ½[c(f) + c*(−f)], and i times that
// of the second is ½[c(f) − c*(−f)].
void PhaseScreens::drift(const ScreenShift& first, const ScreenShift& second,
                         Image<std::complex<float>>& spectrum) const {
  const double width = n_ * spacing_;
  const auto first_x = shift_factors(n_, first.x / width);
  const auto first_y = shift_factors(n_, first.y / width);
  const auto second_x = shift_factors(n_, second.x / width);
  const auto second_y = shift_factors(n_, second.y / width);
  for (int p = 0; p <= n_ / 2; ++p) {
    const int opposite_p = (n_ - p) % n_;
    for (int q = 0; q < n_; ++q) {
      if (p == opposite_p && q > n_ / 2) break;  // The other side has done the rest.
      const int opposite_q = (n_ - q) % n_;
      const auto at_p = static_cast<std::size_t>(p);
      const auto at_q = static_cast<std::size_t>(q);
      const std::complex<float> c = spectrum(p, q);
      const std::complex<float> d = std::conj(spectrum(opposite_p, opposite_q));
      const std::complex<float> a = 0.5F * (c + d) * first_x[at_p] * first_y[at_q];
      const std::complex<float> b = 0.5F * (c - d) * second_x[at_p] * second_y[at_q];
      spectrum(p, q) = a + b;
      spectrum(opposite_p, opposite_q) = std::conj(a - b);
    }
  }
}

// At each level, Re Σ c exp(2πi(fx·x + fy·y)) is the sum of three products of a function of y with
// one of x.
void PhaseScreens::add_subharmonics(RandomStream& random, const ScreenShift& shift, bool imaginary,
                                    Image<std::complex<float>>& screens) {
  along_x_.setZero();
  for (const Slow& slow : slow_) {
    const double re = random.gaussian();
    const double im = random.gaussian();
    const Complex c = std::sqrt(slow.power) * Complex(re, im) *
                      std::polar(1.0, -kTwoPi * (slow.fx * shift.x + slow.fy * shift.y));
    const double sign = slow.fy > 0.0 ? 1.0 : -1.0;
    const Eigen::Index row = 3L * slow.level;
    for (int j = 0; j < n_; ++j) {
      const Complex value = c * std::polar(1.0, kTwoPi * slow.fx * j * spacing_);
      if (slow.fy == 0.0) {
        along_x_(row, j) += static_cast<float>(value.real());
      } else {
        along_x_(row + 1, j) += static_cast<float>(value.real());
        along_x_(row + 2, j) -= static_cast<float>(sign * value.imag());
      }
    }
  }
  for (int i = 0; i < n_; ++i) {
    line_.noalias() = along_y_.row(i) * along_x_;
    for (int j = 0; j < n_; ++j) {
      if (imaginary) {
        screens(i, j) += std::complex<float>(0.0F, line_(j));
      } else {
        screens(i, j) += line_(j);
      }
    }
  }
}

double PhaseScreens::expected_variance() const {
  double sum = 0.0;
  for (int i = -(n_ / 2 - 1); i < n_ / 2; ++i) {
    for (int j = -(n_ / 2 - 1); j < n_ / 2; ++j) {
      sum += std::pow(static_cast<double>(amplitude_(std::abs(i), std::abs(j))), 2);
    }
  }
  for (const Slow& slow : slow_) sum += slow.power;
  return sum;
}

double PhaseScreens::expected_structure(double x, double y) const {
  const double step = 1.0 / (n_ * spacing_);
  double sum = 0.0;
  for (int i = -(n_ / 2 - 1); i < n_ / 2; ++i) {
    for (int j = -(n_ / 2 - 1); j < n_ / 2; ++j) {
      const double power = std::pow(static_cast<double>(amplitude_(std::abs(i), std::abs(j))), 2);
      sum += 2.0 * power * (1.0 - std::cos(kTwoPi * step * (j * x + i * y)));
    }
  }
  for (const Slow& slow : slow_) {
    sum += 2.0 * slow.power * (1.0 - std::cos(kTwoPi * (slow.fx * x + slow.fy * y)));
  }
  return sum;
}

}  // namespace curlew
