// This makes slopes of vortices by quadrature, in double: what an ideal sensor measures, without
// spots.
#pragma once

#include <array>
#include <cmath>
#include <complex>
#include <cstddef>
#include <span>

#include "core/slope_field.h"

namespace curlew {

/// Describes a vortex φ = Im ln u, u = ξ(x+iy) + ζ(x−iy) round (x, y), with ξ = cos(α/2)·e^{iβ/2}
/// and ζ = sin(α/2)·e^{−iβ/2} (docs/paper.md).
struct TestVortex {
  double x = 0.0;          ///< lenslet units
  double y = 0.0;          ///< lenslet units
  int charge = 1;          ///< +1 or −1, which is the conjugate
  double alpha_rad = 0.0;  ///< morphology α in [0, π/2)
  double beta_rad = 0.0;   ///< morphology β
};

namespace analytic_slopes {

// These are the 10 points of Gauss and Legendre on [−1, 1], exact for polynomials to degree 19.
inline constexpr std::array<double, 5> kNode{0.14887433898163121, 0.43339539412924719,
                                             0.67940956829902441, 0.86506336668898451,
                                             0.97390652851717172};
inline constexpr std::array<double, 5> kWeight{0.29552422471475287, 0.26926671930999636,
                                               0.21908636251598204, 0.14945134915058059,
                                               0.06667134430868814};

template <typename Value, typename Function>
Value integrate_once(const Function& f, double from, double to) {
  const double middle = 0.5 * (from + to);
  const double half = 0.5 * (to - from);
  Value sum{};
  for (std::size_t i = 0; i < kNode.size(); ++i) {
    sum += kWeight[i] * half * (f(middle - half * kNode[i]) + f(middle + half * kNode[i]));
  }
  return sum;
}

// Halves the interval until both halves agree with the whole to 1e-13 (an absolute error, of slopes
// near 1).
template <typename Function>
std::complex<double> integrate(const Function& f, double from, double to, int depth = 0) {
  const double middle = 0.5 * (from + to);
  const auto whole = integrate_once<std::complex<double>>(f, from, to);
  const auto halves = integrate_once<std::complex<double>>(f, from, middle) +
                      integrate_once<std::complex<double>>(f, middle, to);
  if (depth >= 50 || std::abs(halves - whole) < 1e-13) return halves;
  return integrate(f, from, middle, depth + 1) + integrate(f, middle, to, depth + 1);
}

// Holds u and its derivatives along x and y at a place relative to the vortex.
struct Factor {
  std::complex<double> u;
  std::complex<double> du_dx;
  std::complex<double> du_dy;
};

inline Factor factor(const TestVortex& v, double x, double y) {
  using namespace std::complex_literals;
  const auto xi = std::polar(std::cos(v.alpha_rad / 2.0), v.beta_rad / 2.0);
  const auto zeta = std::polar(std::sin(v.alpha_rad / 2.0), -v.beta_rad / 2.0);
  const std::complex<double> z(x - v.x, y - v.y);
  Factor f{xi * z + zeta * std::conj(z), xi + zeta, 1i * (xi - zeta)};
  if (v.charge < 0) f = {std::conj(f.u), std::conj(f.du_dx), std::conj(f.du_dy)};
  return f;
}

// Returns ∇φ = Im(∇u / u), as a complex number x + iy.
inline std::complex<double> phase_gradient(const TestVortex& v, double x, double y) {
  const Factor f = factor(v, x, y);
  return {(f.du_dx / f.u).imag(), (f.du_dy / f.u).imag()};
}

// Holds integrals of I and I∇φ.
struct Moments {
  double intensity = 0.0;
  double x = 0.0;
  double y = 0.0;

  Moments operator+(const Moments& m) const { return {intensity + m.intensity, x + m.x, y + m.y}; }
  Moments& operator+=(const Moments& m) { return *this = *this + m; }
};
inline Moments operator*(double scale, const Moments& m) {
  return {scale * m.intensity, scale * m.x, scale * m.y};
}

}  // namespace analytic_slopes

/// Returns the mean of ∇φ over the unit square round lenslet (row, col), rad per pitch (x, y),
/// within 1e-11. ∇φ is homogeneous of degree −1 about the vortex, so that over the triangle from
/// the vortex to the side a→b it integrates to cross(a, b)·∫₀¹ ∇φ(a + s(b−a)) ds; signed triangles
/// make the square.
inline std::array<double, 2> mean_phase_gradient(const TestVortex& v, int row, int col) {
  const std::array<std::complex<double>, 4> corner{
      std::complex<double>(col - 0.5, row - 0.5), std::complex<double>(col + 0.5, row - 0.5),
      std::complex<double>(col + 0.5, row + 0.5), std::complex<double>(col - 0.5, row + 0.5)};
  const std::complex<double> centre(v.x, v.y);
  std::complex<double> sum;
  for (std::size_t k = 0; k < 4; ++k) {
    const std::complex<double> a = corner[k] - centre;
    const std::complex<double> b = corner[(k + 1) % 4] - centre;
    const double cross = a.real() * b.imag() - a.imag() * b.real();
    if (std::abs(cross) < 1e-14) continue;  // On the side's line the limit is 0.
    sum += analytic_slopes::integrate(
        [&](double s) {
          const std::complex<double> at = centre + a + s * (b - a);
          return cross * analytic_slopes::phase_gradient(v, at.real(), at.imag());
        },
        0.0, 1.0);
  }
  return {sum.real(), sum.imag()};
}

/// Returns ∫I∇φ/∫I over lenslet (row, col) for linear cores everywhere: I = Π|u|². It is exact but
/// for rounding for up to 4 vortices, because I∇φ = Im(ū∇u) is a polynomial.
inline std::array<double, 2> weighted_phase_gradient(std::span<const TestVortex> vortices, int row,
                                                     int col) {
  using analytic_slopes::Moments;
  const auto at = [&](double x, double y) {
    analytic_slopes::Factor all{1.0, 0.0, 0.0};
    for (const TestVortex& v : vortices) {
      const auto f = analytic_slopes::factor(v, x, y);
      all = {all.u * f.u, all.du_dx * f.u + all.u * f.du_dx, all.du_dy * f.u + all.u * f.du_dy};
    }
    return Moments{std::norm(all.u), (std::conj(all.u) * all.du_dx).imag(),
                   (std::conj(all.u) * all.du_dy).imag()};
  };
  const Moments m = analytic_slopes::integrate_once<Moments>(
      [&](double y) {
        return analytic_slopes::integrate_once<Moments>([&](double x) { return at(x, y); },
                                                        col - 0.5, col + 0.5);
      },
      row - 0.5, row + 0.5);
  return {m.x / m.intensity, m.y / m.intensity};
}

/// Returns the slopes of the paper's sensor: the uniform mean of ∇φ of all vortices together, every
/// lenslet valid, variances 0. Each value is right to float.
inline SlopeField uniform_vortex_slopes(int rows, int cols, std::span<const TestVortex> vortices) {
  SlopeField slopes(rows, cols);
  for (int row = 0; row < rows; ++row) {
    for (int col = 0; col < cols; ++col) {
      std::array<double, 2> sum{};
      for (const TestVortex& v : vortices) {
        const auto mean = mean_phase_gradient(v, row, col);
        sum = {sum[0] + mean[0], sum[1] + mean[1]};
      }
      slopes.x(row, col) = static_cast<float>(sum[0]);
      slopes.y(row, col) = static_cast<float>(sum[1]);
    }
  }
  slopes.valid.fill(1);
  slopes.n_valid = rows * cols;
  return slopes;
}

/// Returns the slopes of a sensor that weights by intensity, for an amplitude that is linear
/// everywhere: Π|u|.
inline SlopeField linear_core_slopes(int rows, int cols, std::span<const TestVortex> vortices) {
  SlopeField slopes(rows, cols);
  for (int row = 0; row < rows; ++row) {
    for (int col = 0; col < cols; ++col) {
      const auto mean = weighted_phase_gradient(vortices, row, col);
      slopes.x(row, col) = static_cast<float>(mean[0]);
      slopes.y(row, col) = static_cast<float>(mean[1]);
    }
  }
  slopes.valid.fill(1);
  slopes.n_valid = rows * cols;
  return slopes;
}

}  // namespace curlew
