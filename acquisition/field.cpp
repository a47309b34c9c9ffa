#include "acquisition/field.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <numbers>
#include <string>
#include <utility>

#include "core/error.h"

namespace curlew {
namespace {

using Complex = std::complex<double>;

void check_scene(const Scene& scene) {
  for (const SceneVortex& vortex : scene.vortices) {
    if (std::abs(vortex.charge) != 1) {
      throw UsageError("a simulated vortex has charge " + std::to_string(vortex.charge) +
                       "; give +1 or -1, and several at one place for more");
    }
    if (!(vortex.alpha_rad >= 0.0 && vortex.alpha_rad < std::numbers::pi / 2.0)) {
      throw UsageError(
          "a simulated vortex has alpha outside [0, pi/2) rad; give alpha there, and its sign by "
          "the charge");
    }
    if (!std::isfinite(vortex.x) || !std::isfinite(vortex.y) || !std::isfinite(vortex.beta_rad)) {
      throw UsageError("a simulated vortex has a position or beta that is not a number; give one");
    }
  }
  if (!(scene.core_radius > 0.0)) {
    throw UsageError("the core radius of simulated vortices must be above 0 pitches");
  }
  const bool finite = std::isfinite(scene.tilt_x_rad) && std::isfinite(scene.tilt_y_rad) &&
                      std::isfinite(scene.velocity_x) && std::isfinite(scene.velocity_y) &&
                      std::all_of(scene.zernikes.begin(), scene.zernikes.end(),
                                  [](const auto& z) { return std::isfinite(z.rms_rad); });
  if (!finite) {
    throw UsageError("a tilt, velocity or Zernike rms of the scene is not a finite number");
  }
}

// Turns (whole) of the phase round (j,i) → (j+1,i) → (j+1,i+1) → (j,i+1), from +x towards +y.
int winding(const std::array<Complex, 4>& corner) {
  double sum = 0.0;
  for (std::size_t c = 0; c < 4; ++c) sum += std::arg(corner[(c + 1) % 4] * std::conj(corner[c]));
  return static_cast<int>(std::lround(sum / (2.0 * std::numbers::pi)));
}

double cross(Complex a, Complex b) { return a.real() * b.imag() - a.imag() * b.real(); }

// Where a + b·s + c·t + d·s·t is 0 within the plaquette, (s, t) in [0, 1]²; its middle where
// rounding hides the zero. Eliminating t leaves a quadratic in s.
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
  for (int i = 0; i + 1 < field.values.rows(); ++i) {
    for (int j = 0; j + 1 < field.values.cols(); ++j) {
      const std::array<Complex, 4> corner{field.values(i, j), field.values(i, j + 1),
                                          field.values(i + 1, j + 1), field.values(i + 1, j)};
      const int charge = winding(corner);
      if (charge == 0) continue;
      const auto [s, t] = find_bilinear_zero(corner);
      SceneVortex vortex;
      vortex.x = (j + s + 0.5) / n - 0.5;
      vortex.y = (i + t + 0.5) / n - 0.5;
      vortex.charge = charge;
      found.push_back(vortex);
    }
  }
  return found;
}

Beam::Beam(const Scene& scene, int rows, int cols, int samples, double disc_radius,
           SampledField field)
    : scene_(scene),
      rows_(rows),
      cols_(cols),
      samples_(samples),
      disc_radius_(disc_radius),
      field_(std::move(field)),
      moves_(!scene.vortices.empty() && (scene.velocity_x != 0.0 || scene.velocity_y != 0.0)) {
  check_scene(scene);
  for (const SceneVortex& vortex : scene.vortices) {
    const double half_alpha = 0.5 * vortex.alpha_rad;
    const double half_beta = 0.5 * vortex.beta_rad;
    factors_.push_back({vortex.x, vortex.y, std::polar(std::cos(half_alpha), half_beta),
                        std::polar(std::sin(half_alpha), -half_beta), vortex.charge});
  }
  for (const SceneZernike& term : scene.zernikes) {
    modes_.push_back({Zernike(term.noll), term.rms_rad});
  }
  if (!field_.values.empty()) field_vortices_ = find_field_vortices(field_);
}

std::vector<SceneVortex> Beam::vortices(std::int64_t frame) const {
  std::vector<SceneVortex> all = scene_.vortices;
  for (SceneVortex& vortex : all) {
    vortex.x += scene_.velocity_x * static_cast<double>(frame);
    vortex.y += scene_.velocity_y * static_cast<double>(frame);
  }
  all.insert(all.end(), field_vortices_.begin(), field_vortices_.end());
  return all;
}

void Beam::sample(int row, int col, std::int64_t frame, Image<std::complex<double>>& field) const {
  const double n = samples_;
  const double moved_x = scene_.velocity_x * static_cast<double>(frame);
  const double moved_y = scene_.velocity_y * static_cast<double>(frame);
  const double centre_x = 0.5 * (cols_ - 1);
  const double centre_y = 0.5 * (rows_ - 1);
  const bool linear = scene_.vortex_amplitude == VortexAmplitude::kLinearCore;

  for (int i = 0; i < samples_; ++i) {
    const double y = row + (i + 0.5) / n - 0.5;
    for (int j = 0; j < samples_; ++j) {
      const double x = col + (j + 0.5) / n - 0.5;
      double phase = scene_.tilt_x_rad * (x - centre_x) + scene_.tilt_y_rad * (y - centre_y);
      for (const Mode& mode : modes_) {
        phase += mode.rms_rad *
                 mode.zernike((x - centre_x) / disc_radius_, (y - centre_y) / disc_radius_);
      }
      Complex value = std::polar(1.0, phase);
      for (const Factor& vortex : factors_) {
        const Complex z(x - vortex.x - moved_x, y - vortex.y - moved_y);
        Complex u = vortex.xi * z + vortex.zeta * std::conj(z);
        const double size = std::abs(u);
        u = size > 0.0 ? u / size : Complex(1.0, 0.0);
        if (linear) u *= std::min(size / scene_.core_radius, 1.0);
        if (vortex.charge < 0) u = std::conj(u);
        value *= u;
      }
      if (!field_.values.empty()) {
        value *= Complex(field_.values(row * samples_ + i, col * samples_ + j));
      }
      field(i, j) = value;
    }
  }
}

}  // namespace curlew
