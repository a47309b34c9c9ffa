#include "acquisition/simulator/simulator_options.h"

#include <algorithm>
#include <cmath>
#include <sstream>

#include "core/error.h"
#include "core/memory_limit.h"

namespace curlew {
namespace {

constexpr int kLargestDetectorPx = 32768;

double circle_radius(const SimulatorOptions& o) { return 0.5 * std::min(o.rows, o.cols); }

}  // namespace

void check_simulator_options(const SimulatorOptions& o) {
  require(o.rows >= 1 && o.cols >= 1 && o.window_px >= 1,
          "the simulator needs at least one lenslet row, one column and one pixel a window");
  require(o.rows <= kLargestDetectorPx / o.window_px && o.cols <= kLargestDetectorPx / o.window_px,
          "the simulated detector would be wider than 32768 pixels; take fewer lenslets or a "
          "smaller window");
  require(std::isfinite(o.samples_per_lambda_w) && o.samples_per_lambda_w > 0.0,
          "samples per lambda/w must be a number above 0");
  require(o.field_samples >= 2 && o.field_samples <= kMaxFieldSamples,
          "field samples per lenslet must lie between 2 and 1024");
  require(o.pupil != PupilShape::kObscured || (o.obscuration >= 0.0 && o.obscuration < 1.0),
          "the obscuration ratio must lie in [0, 1)");
  require(o.photons >= 0.0, "photons must be 0 or more");
  require(std::isfinite(o.background_e) && o.background_e >= 0.0 && std::isfinite(o.read_noise_e) &&
              o.read_noise_e >= 0.0,
          "background and read noise must be 0 electrons or more");
  require(std::isfinite(o.e_per_adu) && o.e_per_adu > 0.0, "e_per_adu must be a number above 0");
  require(o.bit_depth == 8 || (o.bit_depth >= 10 && o.bit_depth <= 16),
          "the bit depth must be 8 or lie between 10 and 16");
  const double largest = std::ldexp(1.0, o.bit_depth) - 1.0;
  require(o.saturation_adu == 0.0 || (o.saturation_adu >= 1.0 && o.saturation_adu <= largest),
          "saturation must lie between 1 and the largest count of the bit depth, or be 0 for that "
          "count");
  require(o.bias_adu >= 0.0 &&
              o.bias_adu < (o.saturation_adu > 0.0 ? std::floor(o.saturation_adu) : largest),
          "the bias must be 0 ADU or more and below saturation");
  require(o.scene.field_file.empty() || !o.turbulence,
          "a field file and turbulence cannot be had at once; leave one out");
  const double frame_rows = static_cast<double>(o.rows) * o.window_px;
  const double frame_cols = static_cast<double>(o.cols) * o.window_px;
  require_memory("simulating " + std::to_string(o.rows) + " x " + std::to_string(o.cols) +
                     " lenslets of " + std::to_string(o.window_px) + " pixels a side",
                 12.0 * frame_rows * frame_cols);
}

bool is_noisy(const SimulatorOptions& o) { return o.photons > 0.0 && std::isfinite(o.photons); }

int min_field_samples(const SimulatorOptions& o) {
  constexpr int kMinimum = 16;
  return std::max(kMinimum, static_cast<int>(std::ceil(o.window_px / o.samples_per_lambda_w)));
}

PropagationGrid propagation_grid(const SimulatorOptions& o) {
  return choose_grid(o.turbulence.value(), o.rows, o.cols, min_field_samples(o));
}

Image<std::uint8_t> find_lit_lenslets(const SimulatorOptions& o) {
  Image<std::uint8_t> lit(o.rows, o.cols, 1);
  if (o.pupil == PupilShape::kSquare) return lit;
  const double outer = circle_radius(o);
  const double inner = o.pupil == PupilShape::kObscured ? o.obscuration * outer : 0.0;
  for (int row = 0; row < o.rows; ++row) {
    for (int col = 0; col < o.cols; ++col) {
      const double distance = std::hypot(row - 0.5 * (o.rows - 1), col - 0.5 * (o.cols - 1));
      lit(row, col) = distance <= outer && distance >= inner ? 1 : 0;
    }
  }
  return lit;
}

double pupil_disc_radius(const SimulatorOptions& o) {
  return o.pupil == PupilShape::kSquare ? 0.5 * std::hypot(o.rows, o.cols) : circle_radius(o);
}

const std::vector<std::string>& simulator_presets() {
  static const std::vector<std::string> names{"plane",  "tilt",  "zernike",    "vortex",
                                              "dipole", "field", "turbulence", "chen2007"};
  return names;
}

void add_preset(std::string_view name, const PresetParameters& p, SimulatorOptions& options) {
  Scene& scene = options.scene;
  SceneVortex vortex;
  vortex.x = std::isnan(p.x) ? std::floor(0.5 * (options.cols - 1)) + 0.5 : p.x;
  vortex.y = std::isnan(p.y) ? std::floor(0.5 * (options.rows - 1)) + 0.5 : p.y;
  vortex.alpha_rad = p.alpha_rad;
  vortex.beta_rad = p.beta_rad;
  if (name == "plane") return;
  if (name == "tilt") {
    scene.tilt_x_rad += p.tilt_x_rad;
    scene.tilt_y_rad += p.tilt_y_rad;
  } else if (name == "zernike") {
    scene.zernikes.push_back({p.noll, p.rms_rad});
  } else if (name == "vortex") {
    vortex.charge = p.charge;
    scene.vortices.push_back(vortex);
  } else if (name == "dipole") {
    vortex.charge = 1;
    scene.vortices.push_back(vortex);
    vortex.charge = -1;
    vortex.x += p.separation;
    scene.vortices.push_back(vortex);
  } else if (name == "field") {
    require(!p.field_file.empty(), "the preset field needs a FITS file; name one");
    scene.field_file = p.field_file;
  } else if (name == "turbulence") {
    options.turbulence = TurbulentPath{};
  } else if (name == "chen2007") {
    options.turbulence = chen2007_path();
  } else {
    std::ostringstream message;
    message << "there is no preset '" << name << "'; take one of";
    for (std::size_t i = 0; i < simulator_presets().size(); ++i) {
      message << (i == 0 ? " " : ", ") << simulator_presets()[i];
    }
    throw UsageError(message.str());
  }
}

}  // namespace curlew
