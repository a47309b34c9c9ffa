#include "service/bench/position_bound.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include "acquisition/simulator/lenslet_optics.h"

namespace curlew {
namespace {

using Complex = std::complex<double>;

constexpr double kManyPhotons = 1e9;  // photons of a lenslet that are as good as no noise
// The table of PixelInformation has means in electrons. Brighter pixels are Gaussian to 1 %.
constexpr int kSteps = 73;
constexpr double kFaintest = 1e-4;
constexpr double kStep = 0.185;  // of ln mean, so that the table reaches 73 electrons

/// Returns ∫ (∂p/∂mean)²/p for p(y) = Σ Poisson(n)·Gauss(y − n), by sums over y and n.
double integrate_information(double mean, double sigma) {
  const double reach = 7.0 * sigma;
  const int maximum = static_cast<int>(mean + 9.0 * std::sqrt(mean) + 20.0);
  const double step = sigma / 8.0;
  const int steps = static_cast<int>((maximum + 2.0 * reach) / step);
  std::vector<double> poisson{std::exp(-mean)};
  for (int n = 1; n <= maximum; ++n) poisson.push_back(poisson.back() * mean / n);
  double information = 0.0;
  for (int s = 0; s <= steps; ++s) {
    const double y = s * step - reach;
    const int low = std::max(0, static_cast<int>(std::floor(y - 1.0 - reach)));
    const int high = std::min(maximum, static_cast<int>(std::ceil(y + reach)));
    const auto gauss = [&](double z) { return std::exp(-0.5 * z * z / (sigma * sigma)); };
    double density = 0.0;
    double slope = 0.0;
    for (int n = low; n <= high; ++n) {
      const double part = poisson[static_cast<std::size_t>(n)];
      density += part * gauss(y - n);
      slope += part * (gauss(y - n - 1.0) - gauss(y - n));
    }
    if (density > 0.0) information += slope * slope / density;
  }
  return information * step / (sigma * std::sqrt(2.0 * std::numbers::pi));
}

struct Place {
  Eigen::Index row;
  Eigen::Index col;
};

/// Returns the lenslets of a patch by their ring round its middle, the innermost first.
std::vector<Place> rings(int lenslets) {
  const auto ring = [half = lenslets / 2](Eigen::Index at) {
    return std::max(half - at, at - half + 1);
  };
  std::vector<Place> places;
  for (int row = 0; row < lenslets; ++row)
    for (int col = 0; col < lenslets; ++col) places.push_back({row, col});
  std::stable_sort(places.begin(), places.end(), [&](const Place& a, const Place& b) {
    return std::max(ring(a.row), ring(a.col)) < std::max(ring(b.row), ring(b.col));
  });
  return places;
}

/// The weights of the four points round a place, which is given in points, for bilinear
/// interpolation and for its slopes.
struct Corners {
  Corners(double x, double y)
      : row(static_cast<int>(std::floor(y))), col(static_cast<int>(std::floor(x))) {
    const double s = x - col;
    const double t = y - row;
    value << (1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t;
    along_x << t - 1, 1 - t, -t, t;
    along_y << s - 1, -s, 1 - s, s;
  }
  int row_of(int corner) const { return row + corner / 2; }
  int col_of(int corner) const { return col + corner % 2; }

  int row;
  int col;
  Eigen::Vector4d value;
  Eigen::Vector4d along_x;  // per point
  Eigen::Vector4d along_y;
};

Eigen::Matrix2Xd displacements(const Eigen::MatrixXcd& patch, const Corners& at,
                               const FieldModes& modes, double amplitude) {
  const int n = modes.samples;
  Eigen::Vector4cd around;
  Eigen::MatrixXcd modes_around(4, modes.count());
  for (int corner = 0; corner < 4; ++corner) {
    const int row = at.row_of(corner);
    const int col = at.col_of(corner);
    around(corner) = patch(row, col);
    const auto lenslet =
        static_cast<std::size_t>(row / n) * static_cast<std::size_t>(modes.lenslets) +
        static_cast<std::size_t>(col / n);
    modes_around.row(corner) = modes.values[lenslet].row(row % n * n + col % n);
  }
  const Complex along_x =
      static_cast<double>(n) * (at.along_x.cast<Complex>().transpose() * around).value();
  const Complex along_y =
      static_cast<double>(n) * (at.along_y.cast<Complex>().transpose() * around).value();
  Eigen::Matrix2d gradient;
  gradient << along_x.real(), along_y.real(), along_x.imag(), along_y.imag();
  const Eigen::RowVectorXcd here =
      amplitude * (at.value.cast<Complex>().transpose() * modes_around);
  Eigen::Matrix2Xd moved(2, 2 * modes.count());
  // Along the coefficients' real, then their imaginary parts.
  moved << here.real(), -here.imag(), here.imag(), here.real();
  return -gradient.inverse() * moved;
}

}  // namespace

PixelInformation::PixelInformation(double read_noise_e) : variance_(read_noise_e * read_noise_e) {
  if (read_noise_e <= 0.0) return;
  for (int i = 0; i <= kSteps; ++i) {
    const double mean = kFaintest * std::exp(i * kStep);
    products_.push_back((mean + variance_) * integrate_information(mean, read_noise_e));
  }
}

double PixelInformation::operator()(double mean_e) const {
  if (products_.empty()) return 1.0 / std::max(mean_e, kFaintest);
  const double at = std::log(std::max(mean_e, kFaintest) / kFaintest) / kStep;
  if (at >= kSteps) return 1.0 / (mean_e + variance_);
  const auto below = static_cast<std::size_t>(at);
  const double part = at - static_cast<double>(below);
  return ((1.0 - part) * products_[below] + part * products_[below + 1]) / (mean_e + variance_);
}

SpotDerivative::SpotDerivative(int samples, double pixels_per_lambda_w, int window_px)
    : pixels_from_intensity_(integrate_pixels(samples, pixels_per_lambda_w, window_px)),
      far_field_(2 * samples, samples) {
  for (int k = 0; k < 2 * samples; ++k)
    for (int i = 0; i < samples; ++i)
      far_field_(k, i) = std::polar(1.0, -std::numbers::pi * k * i / samples);
}

void SpotDerivative::linearise(const Eigen::MatrixXcd& field, Eigen::VectorXd& light,
                               Eigen::MatrixXcd& gradient) const {
  const Eigen::MatrixXd& b = pixels_from_intensity_;
  const Eigen::MatrixXcd conjugate = (far_field_ * field * far_field_.transpose()).conjugate();
  const Eigen::Index px = b.rows();
  const Eigen::Index n = field.rows();
  light.resize(px * px);
  gradient.resize(px * px, n * n);
  for (Eigen::Index i = 0; i < px; ++i) {
    const Eigen::MatrixXcd rows =
        (b.row(i).transpose().asDiagonal() * far_field_).transpose() * conjugate;
    for (Eigen::Index j = 0; j < px; ++j) {
      const Eigen::MatrixXcd h = 2.0 * rows * (b.row(j).transpose().asDiagonal() * far_field_);
      for (Eigen::Index y = 0; y < n; ++y) gradient.row(i * px + j).segment(y * n, n) = h.row(y);
      light(i * px + j) = 0.5 * h.cwiseProduct(field).sum().real();
    }
  }
}

VortexView view_vortex(const SampledField& field, const GradedVortex& vortex, int rows, int cols,
                       const FieldModes& modes, const SpotDerivative& spots) {
  const int lenslets = modes.lenslets;
  const Eigen::Index n = modes.samples;
  const bool mirrored = vortex.charge < 0;
  const Eigen::MatrixXcd patch = cut_patch(field, vortex, lenslets);
  const int first_row = static_cast<int>(std::floor(vortex.y)) + 1 - lenslets / 2;
  const int first_col = static_cast<int>(std::floor(vortex.x)) + 1 - lenslets / 2;
  const Eigen::Index pixels = static_cast<Eigen::Index>(spots.window_px()) * spots.window_px();

  VortexView view;
  std::vector<Place> seen;
  const std::vector<Place> all = rings(lenslets);
  for (int side = 2; side <= lenslets; side += 2) {
    for (int k = (side - 2) * (side - 2); k < side * side; ++k) {
      const Place& place = all[static_cast<std::size_t>(k)];
      const Eigen::Index row = first_row + place.row;
      const Eigen::Index col = first_col + (mirrored ? lenslets - 1 - place.col : place.col);
      if (row >= 0 && row < rows && col >= 0 && col < cols) seen.push_back(place);
    }
    view.pixels_within.push_back(static_cast<Eigen::Index>(seen.size()) * pixels);
  }
  double power = 0.0;
  for (const Place& place : seen)
    power += patch.block(place.row * n, place.col * n, n, n).cwiseAbs2().mean();
  view.amplitude = std::sqrt(power / static_cast<double>(seen.size()));

  view.light.resize(view.pixels_within.back());
  view.derivative.resize(view.pixels_within.back(), 2 * modes.count());
  Eigen::VectorXd light;
  Eigen::MatrixXcd gradient;
  Eigen::Index at = 0;
  for (const Place& place : seen) {
    spots.linearise(patch.block(place.row * n, place.col * n, n, n), light, gradient);
    const Eigen::MatrixXcd change =
        view.amplitude *
        (gradient * modes.values[static_cast<std::size_t>(place.row * lenslets + place.col)]);
    view.light.segment(at, pixels) = light;
    view.derivative.block(at, 0, pixels, modes.count()) = change.real();
    // Along the coefficients' imaginary parts.
    view.derivative.block(at, modes.count(), pixels, modes.count()) = -change.imag();
    at += pixels;
  }

  const auto in_points = [&](double x, int first) {
    return (x - first + 0.5) * modes.samples - 0.5;
  };
  const double x = in_points(vortex.x, first_col);
  view.displacement = displacements(
      patch, {mirrored ? lenslets * modes.samples - 1.0 - x : x, in_points(vortex.y, first_row)},
      modes, view.amplitude);
  if (mirrored) view.displacement.row(0) *= -1.0;
  return view;
}

std::vector<Eigen::Matrix2d> position_covariances(const VortexView& view, int lenslets,
                                                  const std::vector<double>& photons,
                                                  const PixelInformation& information) {
  const Eigen::Index pixels = view.pixels_within[static_cast<std::size_t>(lenslets / 2 - 1)];
  const auto a = view.derivative.topRows(pixels);
  std::vector<Eigen::Matrix2d> covariances;
  for (const double level : photons) {
    const bool noisy = std::isfinite(level);
    const double electrons = noisy ? level : kManyPhotons;
    Eigen::VectorXd root(pixels);  // the root of W
    for (Eigen::Index p = 0; p < pixels; ++p) {
      const double mean = electrons * view.light(p);
      root(p) = electrons * std::sqrt(noisy ? information(mean) : 1.0 / std::max(mean, 1.0));
    }
    Eigen::MatrixXd precision = Eigen::MatrixXd::Identity(a.cols(), a.cols());
    precision.selfadjointView<Eigen::Lower>().rankUpdate((root.asDiagonal() * a).transpose());
    const Eigen::LLT<Eigen::MatrixXd> cholesky(precision);
    const Eigen::MatrixX2d half = cholesky.matrixL().solve(view.displacement.transpose());
    covariances.emplace_back(half.transpose() * half);
  }
  return covariances;
}

// In the covariance's axes the error is (a cos θ, b sin θ)·ρ, where ρ has Rayleigh's distribution.
// For each θ the integrals over ρ have a closed form.
TruncatedError truncate_error(const Eigen::Matrix2d& covariance, double radius) {
  constexpr int kAngles = 512;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> axes(covariance);
  const Eigen::Vector2d variance = axes.eigenvalues().cwiseMax(1e-12);
  TruncatedError error;
  for (int k = 0; k < kAngles; ++k) {
    const double angle = 2.0 * std::numbers::pi * (k + 0.5) / kAngles;
    const double along = variance(0) * std::cos(angle) * std::cos(angle) +
                         variance(1) * std::sin(angle) * std::sin(angle);
    const double t = 0.5 * radius * radius / along;
    error.probability += (1.0 - std::exp(-t)) / kAngles;
    error.square += 2.0 * along * (1.0 - (1.0 + t) * std::exp(-t)) / kAngles;
  }
  error.square /= error.probability;
  return error;
}

}  // namespace curlew
