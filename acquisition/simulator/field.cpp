#include "acquisition/simulator/field.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numbers>
#include <string>
#include <utility>

#include "acquisition/simulator/field_vortices.h"
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

}  // namespace

Beam::Beam(const Scene& scene, int rows, int cols, int samples, double disc_radius,
           SampledField field)
    : scene_(scene),
      rows_(rows),
      cols_(cols),
      samples_(samples),
      disc_radius_(disc_radius),
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
  set_field(std::move(field));
}

void Beam::set_field(SampledField field) {
  field_ = std::move(field);
  field_vortices_.clear();
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
  const int margin = field_.margin_lenslets * samples_;
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
        value *= Complex(field_.values(row * samples_ + margin + i, col * samples_ + margin + j));
      }
      field(i, j) = value;
    }
  }
}

}  // namespace curlew
