#include "acquisition/simulator/propagation.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace curlew {
namespace {

using Complex = std::complex<double>;
using Line = Eigen::Map<Eigen::ArrayXcf>;
using ConstLine = Eigen::Map<const Eigen::ArrayXcf>;

constexpr double kPi = std::numbers::pi;

// Returns exp(−iπ λz f²) for the frequencies of a line, with λz in units of λL.
Eigen::ArrayXcf free_space(const PropagationGrid& grid, double z) {
  const int n = grid.points;
  Eigen::ArrayXcf factors(n);
  for (int k = 0; k < n; ++k) {
    const double frequency = (k < n / 2 ? k : k - n) / (n * grid.spacing);
    factors(k) = std::complex<float>(std::polar(1.0, -kPi * z * frequency * frequency));
  }
  return factors;
}

VonKarman screen_spectrum(const TurbulentPath& path) {
  return {fried_parameter(path) * std::pow(path.screens, 3.0 / 5.0), path.outer_scale,
          path.inner_scale};
}

// Returns the mean over |x| ≤ half of exp(−2x²/radius²).
double mean_of_gaussian(double half, double radius) {
  const double edge = std::numbers::sqrt2 * half / radius;
  return 0.5 * std::sqrt(kPi) * std::erf(edge) / edge;
}

}  // namespace

Propagation::Propagation(const TurbulentPath& path, int rows, int cols, int min_samples,
                         std::uint64_t seed)
    : path_(path),
      rows_(rows),
      cols_(cols),
      grid_(choose_grid(path, rows, cols, min_samples)),
      screens_(grid_.points, grid_.spacing, screen_spectrum(path), path.waist > 0.0, seed),
      fft_(grid_.points),
      field_(grid_.points, grid_.points),
      pair_(grid_.points, grid_.points) {
  const auto n = static_cast<float>(grid_.points);
  // A forward and an inverse transform together multiply by n², which is n per axis.
  step_ = free_space(grid_, 1.0 / path.screens) / n;
  if (path.waist > 0.0) set_start();
  out_x_ = make_out_axis(cols);
  out_y_ = make_out_axis(rows);
  fine_fft_.SetFlag(Eigen::FFT<float>::Unscaled);
  const int fine = grid_.points * grid_.finer;
  fine_spectrum_.resize(fine);
  fine_line_.resize(fine);
  out_by_frequency_ = Image<std::complex<float>>(grid_.points, out_y_.points);
}

// Makes a Gaussian beam after half a slab of air, and the guard round it.
void Propagation::set_start() {
  const int n = grid_.points;
  start_ = Image<std::complex<float>>(n, n);
  guard_.resize(n);
  const double waist2 = path_.waist * path_.waist;
  const double arriving = path_.waist * std::hypot(1.0, 1.0 / (kPi * waist2));
  const double power = mean_of_gaussian(0.5 * rows_ * path_.lenslet, arriving) *
                       mean_of_gaussian(0.5 * cols_ * path_.lenslet, arriving) * waist2 /
                       (arriving * arriving);
  const Complex curved(1.0, 0.5 / path_.screens / (kPi * waist2));  // 1 + iz/z_R
  const Complex on_axis = 1.0 / (curved * std::sqrt(power));
  for (int i = 0; i < n; ++i) {
    const double y = (i + 0.5 - 0.5 * n) * grid_.spacing;
    // The guard takes 1 % at .35 of the grid's width from the middle, and 98 % at its edge.
    guard_(i) =
        static_cast<float>(std::exp(-std::pow(std::abs(y) / (0.46 * n * grid_.spacing), 16)));
    for (int j = 0; j < n; ++j) {
      const double x = (j + 0.5 - 0.5 * n) * grid_.spacing;
      start_(i, j) = std::complex<float>(on_axis * std::exp(-(x * x + y * y) / (waist2 * curved)));
    }
  }
}

// Fine point m lies at point (m + ½)/finer − ½ of the grid.
Propagation::OutAxis Propagation::make_out_axis(int lenslets) const {
  const int n = grid_.points;
  const int fine = n * grid_.finer;
  OutAxis axis;
  axis.points = (lenslets + 2 * grid_.margin) * field_samples();
  const double first = 0.5 * (fine - axis.points) + 0.5 - 0.5 * grid_.finer;  // in fine points
  axis.first = static_cast<int>(std::floor(first));
  axis.factors = free_space(grid_, 0.5 / path_.screens) / static_cast<float>(n);
  for (int k = 0; k < n; ++k) {
    const double frequency = k < n / 2 ? k : k - n;
    axis.factors(k) *=
        std::complex<float>(std::polar(1.0, 2.0 * kPi * frequency * (first - axis.first) / fine));
  }
  return axis;
}

void Propagation::propagate(std::int64_t frame, SampledField& field) {
  const bool drifting = !path_.wind.empty();
  const auto shift = [&](int screen) {
    const Wind wind = wind_at_screen(path_, screen);
    const double drifted = static_cast<double>(frame) * path_.lenslet;
    return ScreenShift{wind.x * drifted, wind.y * drifted};
  };
  if (start_.empty()) {
    field_.fill({1.0F, 0.0F});
  } else {
    std::copy(start_.begin(), start_.end(), field_.begin());
  }
  for (int screen = 0; screen < path_.screens; ++screen) {
    if (screen > 0) step();
    if (screen % 2 == 0) {
      screens_.draw(drifting ? 0 : frame, screen / 2, shift(screen), shift(screen + 1), fft_,
                    pair_);
    }
    pass_screen(screen % 2 == 1);
  }
  deliver(field);
}

// Multiplies the field by exp(iφ) of one of the two screens at hand, and by the guard.
void Propagation::pass_screen(bool second) {
  const int n = grid_.points;
  using Part = Eigen::Map<const Eigen::ArrayXf, 0, Eigen::InnerStride<2>>;
  Eigen::ArrayXf phase(n);
  Eigen::ArrayXf cosine(n);
  Eigen::ArrayXf sine(n);
  Eigen::ArrayXcf factor(n);
  for (int i = 0; i < n; ++i) {
    phase = Part(reinterpret_cast<const float*>(&pair_(i, 0)) + (second ? 1 : 0), n);
    cosine = phase.cos();  // Lines of their own let Eigen take its vector functions.
    sine = phase.sin();
    factor.real() = cosine;
    factor.imag() = sine;
    if (guard_.size() > 0) factor *= (guard_ * guard_(i)).cast<std::complex<float>>();
    Line(&field_(i, 0), n) *= factor;
  }
}

// Takes the field through free space from screen to screen.
void Propagation::step() {
  const int n = grid_.points;
  fft_.forward(field_);
  for (int p = 0; p < n; ++p) Line(&field_(p, 0), n) *= step_ * step_(p);
  fft_.inverse(field_);
}

// Takes the field through the last half slab and interpolates it, by a longer inverse transform of
// which only the lines and points at the array are made.
void Propagation::deliver(SampledField& field) {
  const int n = grid_.points;
  field.samples_per_lenslet = field_samples();
  field.margin_lenslets = grid_.margin;
  if (field.values.rows() != out_y_.points || field.values.cols() != out_x_.points) {
    field.values = Image<std::complex<float>>(out_y_.points, out_x_.points);
  }
  fft_.forward(field_);
  for (int p = 0; p < n; ++p) make_finer(out_y_, &field_(p, 0), &out_by_frequency_(p, 0));
  transpose(out_by_frequency_, out_by_row_);
  for (int i = 0; i < out_y_.points; ++i) {
    make_finer(out_x_, &out_by_row_(i, 0), &field.values(i, 0));
  }
}

void Propagation::make_finer(const OutAxis& axis, const std::complex<float>* spectrum,
                             std::complex<float>* out) {
  const int n = grid_.points;
  const int fine = n * grid_.finer;
  const ConstLine all(spectrum, n);
  fine_spectrum_.setZero();
  fine_spectrum_.head(n / 2) = all.head(n / 2) * axis.factors.head(n / 2);
  fine_spectrum_.tail(n / 2) = all.tail(n / 2) * axis.factors.tail(n / 2);
  fine_fft_.inv(fine_line_.data(), fine_spectrum_.data(), fine);
  for (int k = 0, m = (axis.first + fine) % fine; k < axis.points; ++k) {
    out[k] = fine_line_(m);
    m = m + 1 < fine ? m + 1 : 0;
  }
}

}  // namespace curlew
