#include "acquisition/simulator/field_vortices.h"

#include <array>
#include <cmath>
#include <complex>
#include <cstddef>
#include <utility>

namespace curlew {
namespace {

using Complex = std::complex<double>;

double cross(Complex a, Complex b) { return a.real() * b.imag() - a.imag() * b.real(); }

// Returns +1 or −1, by the direction, if the straight way from a to b crosses the positive real
// axis, and 0 otherwise. The products of floats are exact in double, so that the way back always
// takes back what this counts.
int crossing(Complex a, Complex b) {
  const bool from_below = a.imag() < 0.0;
  if (from_below == (b.imag() < 0.0)) return 0;
  const double side = cross(a, b);
  if (from_below) return side > 0.0 ? 1 : 0;
  return side < 0.0 ? -1 : 0;
}

// Returns how often the phase turns round (j,i) → (j+1,i) → (j+1,i+1) → (j,i+1), from +x towards
// +y.
int winding(const std::array<Complex, 4>& corner) {
  int turns = 0;
  for (std::size_t c = 0; c < 4; ++c) turns += crossing(corner[c], corner[(c + 1) % 4]);
  return turns;
}

// Returns the place (s, t) in [0, 1]² where a + b·s + c·t + d·s·t is 0 within the plaquette, or its
// middle if rounding hides the zero. Eliminating t leaves a quadratic in s.
std::pair<double, double> find_bilinear_zero(const std::array<Complex, 4>& corner) {
  const Complex a = corner[0];
  const Complex b = corner[1] - corner[0];
  const Complex c = corner[3] - corner[0];
  const Complex d = corner[2] - corner[1] - corner[3] + corner[0];
  const double p0 = cross(a, c);
  const double p1 = cross(b, c) + cross(a, d);
  const double p2 = cross(b, d);
  std::array<double, 2> roots{};
  std::size_t n_roots = 0;
  const double discriminant = p1 * p1 - 4.0 * p2 * p0;
  if (discriminant >= 0.0) {
    const double q = -0.5 * (p1 + std::copysign(std::sqrt(discriminant), p1));
    if (p2 != 0.0) roots[n_roots++] = q / p2;
    if (q != 0.0) roots[n_roots++] = p0 / q;
  }
  for (std::size_t r = 0; r < n_roots; ++r) {
    const double s = roots[r];
    const Complex along = c + d * s;
    if (std::norm(along) == 0.0) continue;
    const double t = -(((a + b * s) * std::conj(along)).real()) / std::norm(along);
    constexpr double kRounding = 1e-6;
    if (s > -kRounding && s < 1.0 + kRounding && t > -kRounding && t < 1.0 + kRounding) {
      return {s, t};
    }
  }
  return {0.5, 0.5};
}

}  // namespace

std::vector<SceneVortex> find_field_vortices(const SampledField& field) {
  std::vector<SceneVortex> found;
  const double n = field.samples_per_lenslet;
  const double first = -field.margin_lenslets - 0.5;  // lenslet units, where the field begins
  for (int i = 0; i + 1 < field.values.rows(); ++i) {
    for (int j = 0; j + 1 < field.values.cols(); ++j) {
      const std::array<Complex, 4> corner{field.values(i, j), field.values(i, j + 1),
                                          field.values(i + 1, j + 1), field.values(i + 1, j)};
      const int charge = winding(corner);
      if (charge == 0) continue;
      const auto [s, t] = find_bilinear_zero(corner);
      SceneVortex vortex;
      vortex.x = (j + s + 0.5) / n + first;
      vortex.y = (i + t + 0.5) / n + first;
      vortex.charge = charge;
      found.push_back(vortex);
    }
  }
  return found;
}

}  // namespace curlew
