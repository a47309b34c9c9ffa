#include "acquisition/simulator/simulator.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>

#include "acquisition/simulator/field_file.h"
#include "acquisition/simulator/random_stream.h"
#include "core/error.h"

namespace curlew {
namespace {

constexpr double kPixelM = 10e-6;
constexpr double kWavelengthM = 633e-9;
constexpr double kNoiseFreePeak = 0.75;  // part of the range from bias to saturation

// Returns how many pixels the far field reaches beyond the window on each side: all of its period.
int stray_margin_px(const SimulatorOptions& o) {
  if (o.stray_light == StrayLight::kCropped) return 0;
  const double period_px = o.field_samples * o.samples_per_lambda_w * (1.0 + 1e-9);
  return std::max(0, static_cast<int>(std::floor(0.5 * (period_px - o.window_px))));
}

FrameFormat make_format(const SimulatorOptions& o) {
  FrameFormat format;
  format.rows = o.rows * o.window_px;
  format.cols = o.cols * o.window_px;
  format.pixel_type = o.bit_depth == 8 ? PixelType::kU8 : PixelType::kU16;
  return format;
}

Optics make_optics(const SimulatorOptions& o) {
  Optics optics;
  optics.pixel_m = kPixelM;
  optics.wavelength_m = kWavelengthM;
  optics.pitch_m = o.window_px * kPixelM;
  optics.focal_m = o.samples_per_lambda_w * kPixelM * optics.pitch_m / kWavelengthM;
  return optics;
}

Detector make_detector(const SimulatorOptions& o) {
  Detector detector;
  detector.e_per_adu = o.e_per_adu;
  detector.read_noise_e = is_noisy(o) ? o.read_noise_e : 0.0;
  detector.saturation_adu =
      o.saturation_adu > 0.0 ? std::floor(o.saturation_adu) : std::ldexp(1.0, o.bit_depth) - 1.0;
  detector.bit_depth = o.bit_depth;
  return detector;
}

// Scales the field so that the mean of |field|² over the lit lenslets is 1. Files come in all
// units, and photons must mean what they say.
void normalise_power(const SimulatorOptions& o, SampledField& field) {
  const Image<std::uint8_t> lit = find_lit_lenslets(o);
  const int n = field.samples_per_lenslet;
  double power = 0.0;
  double count = 0.0;
  for (int i = 0; i < field.values.rows(); ++i) {
    for (int j = 0; j < field.values.cols(); ++j) {
      if (lit(i / n, j / n) == 0) continue;
      power += static_cast<double>(std::norm(field.values(i, j)));
      count += 1.0;
    }
  }
  if (!(power > 0.0) || !std::isfinite(power)) {
    throw Failure(o.scene.field_file +
                  " holds a field that is dark or not finite over the pupil; give one with light");
  }
  const auto scale = static_cast<float>(std::sqrt(count / power));
  for (auto& value : field.values) value *= scale;
}

// Checks what the user asked for and reads the field file. That file, or the turbulence's grid,
// decides how finely lenslets are sampled.
SampledField resolve(SimulatorOptions& o) {
  check_simulator_options(o);
  if (o.turbulence) {
    const PropagationGrid grid = propagation_grid(o);
    o.field_samples = grid.samples_per_lenslet * grid.finer;
    return {};
  }
  if (o.scene.field_file.empty()) return {};
  SampledField field = read_sampled_field(o.scene.field_file, o.rows, o.cols);
  o.field_samples = field.samples_per_lenslet;
  normalise_power(o, field);
  return field;
}

std::optional<Propagation> make_propagation(const SimulatorOptions& o) {
  if (!o.turbulence) return std::nullopt;
  return Propagation(*o.turbulence, o.rows, o.cols, min_field_samples(o), o.seed);
}

}  // namespace

// resolve() completes `options` before the other constructor's body reads them by reference.
Simulator::Simulator(SimulatorOptions options) : Simulator(options, resolve(options)) {}

Simulator::Simulator(const SimulatorOptions& options, SampledField field)
    : options_(options),
      format_(make_format(options)),
      optics_(make_optics(options)),
      detector_(make_detector(options)),
      lit_(find_lit_lenslets(options)),
      propagation_(make_propagation(options)),
      beam_(options.scene, options.rows, options.cols, options.field_samples,
            pupil_disc_radius(options), std::move(field)),
      lenslet_optics_(options.field_samples, options.samples_per_lambda_w,
                      options.window_px + 2 * stray_margin_px(options)),
      electrons_(is_noisy(options) ? options.photons : 0.0),
      lenslet_field_(options.field_samples, options.field_samples),
      patch_(lenslet_optics_.patch_px(), lenslet_optics_.patch_px()),
      expected_e_(format_.rows, format_.cols) {
  if (!is_noisy(options)) options_.background_e = 0.0;
  compute_expected_image(0);
}

Delivery Simulator::next(FrameBuffer& into) {
  if (options_.frames >= 0 && next_frame_ >= options_.frames) return Delivery::kEnd;
  render(next_frame_++, into);
  return Delivery::kFrame;
}

void Simulator::render(std::int64_t frame, FrameBuffer& into) {
  if (into.format().bytes() != format_.bytes()) {
    throw Failure("the frame buffer is not of the simulated frames' size; make it from format()");
  }
  expected_image_e(frame);
  const bool saturated = format_.pixel_type == PixelType::kU8
                             ? expose(frame, reinterpret_cast<std::uint8_t*>(into.data()))
                             : expose(frame, reinterpret_cast<std::uint16_t*>(into.data()));
  into.header.sequence = frame;
  into.header.camera_ns = frame * kFramePeriodNs;
  into.header.received_ns = 0;
  into.header.received = std::chrono::steady_clock::now();
  into.header.status = saturated ? kFrameSaturated : kFrameOk;
  into.rows_ready.store(format_.rows, std::memory_order_release);
}

LensletGrid Simulator::grid() const {
  LensletGrid grid;
  grid.rows = options_.rows;
  grid.cols = options_.cols;
  grid.origin_x_px = 0.5 * (options_.window_px - 1);
  grid.origin_y_px = grid.origin_x_px;
  grid.p11 = options_.window_px;
  grid.p22 = options_.window_px;
  return grid;
}

std::vector<SceneVortex> Simulator::vortices(std::int64_t frame) {
  move_beam_to(frame);
  return beam_.vortices(frame);
}

SampledField Simulator::field(std::int64_t frame) {
  move_beam_to(frame);
  const int n = options_.field_samples;
  SampledField field;
  field.samples_per_lenslet = n;
  field.values = Image<std::complex<float>>(options_.rows * n, options_.cols * n);
  for (int row = 0; row < options_.rows; ++row) {
    for (int col = 0; col < options_.cols; ++col) {
      beam_.sample(row, col, frame, lenslet_field_);
      for (int i = 0; i < n; ++i) {
        for (int j = 0; j < n; ++j)
          field.values(row * n + i, col * n + j) = std::complex<float>(lenslet_field_(i, j));
      }
    }
  }
  return field;
}

std::vector<TruthVortex> Simulator::truth(std::int64_t frame) {
  const std::vector<SceneVortex> all = vortices(frame);
  std::vector<TruthVortex> seen;
  for (const SceneVortex& vortex : all) {
    if (!(std::abs(vortex.x - 0.5 * (options_.cols - 1)) <= 0.5 * options_.cols) ||
        !(std::abs(vortex.y - 0.5 * (options_.rows - 1)) <= 0.5 * options_.rows)) {
      continue;
    }
    double separation = std::numeric_limits<double>::infinity();
    for (const SceneVortex& other : all) {
      if (other.charge * vortex.charge < 0) {
        separation = std::min(separation, std::hypot(other.x - vortex.x, other.y - vortex.y));
      }
    }
    seen.push_back({frame, vortex.x, vortex.y, vortex.charge, separation});
  }
  return seen;
}

const Image<float>& Simulator::expected_image_e(std::int64_t frame) {
  const bool changes = beam_.moves() || propagation_.has_value();
  if (changes && frame != expected_frame_) compute_expected_image(frame);
  return expected_e_;
}

void Simulator::move_beam_to(std::int64_t frame) {
  if (!propagation_ || frame == beam_frame_) return;
  SampledField field;
  propagation_->propagate(frame, field);
  beam_.set_field(std::move(field));
  beam_frame_ = frame;
}

void Simulator::compute_expected_image(std::int64_t frame) {
  move_beam_to(frame);
  expected_e_.fill(0.0F);
  const int margin = (lenslet_optics_.patch_px() - options_.window_px) / 2;
  for (int row = 0; row < options_.rows; ++row) {
    for (int col = 0; col < options_.cols; ++col) {
      if (lit_(row, col) == 0) continue;
      beam_.sample(row, col, frame, lenslet_field_);
      lenslet_optics_.propagate(lenslet_field_, patch_);
      const int top = row * options_.window_px - margin;
      const int left = col * options_.window_px - margin;
      for (int i = 0; i < patch_.rows(); ++i) {
        for (int j = 0; j < patch_.cols(); ++j) {
          if (!expected_e_.contains(top + i, left + j)) continue;
          expected_e_(top + i, left + j) += static_cast<float>(patch_(i, j));
        }
      }
    }
  }
  if (electrons_ == 0.0 || (propagation_ && !is_noisy(options_))) {
    const auto peak =
        static_cast<double>(*std::max_element(expected_e_.begin(), expected_e_.end()));
    const double range_adu = detector_.saturation_adu - options_.bias_adu;
    electrons_ = peak > 0.0 ? kNoiseFreePeak * range_adu * options_.e_per_adu / peak : 1.0;
  }
  for (float& value : expected_e_) {
    value = static_cast<float>(options_.background_e + electrons_ * static_cast<double>(value));
  }
  expected_frame_ = frame;
}

// Returns whether any pixel reached saturation.
template <typename Count>
bool Simulator::expose(std::int64_t frame, Count* counts) const noexcept {
  RandomStream random(options_.seed, static_cast<std::uint64_t>(frame));
  const bool noisy = is_noisy(options_);
  const double adu_per_e = 1.0 / options_.e_per_adu;
  const double read_noise_e = detector_.read_noise_e;
  const double saturation_adu = detector_.saturation_adu;
  bool saturated = false;
  for (std::size_t k = 0; k < expected_e_.size(); ++k) {
    auto electrons = static_cast<double>(expected_e_[k]);
    if (noisy) {
      electrons = random.poisson(electrons);
      if (read_noise_e > 0.0) electrons += read_noise_e * random.gaussian();
    }
    const double adu = std::floor(options_.bias_adu + electrons * adu_per_e + 0.5);
    if (adu >= saturation_adu) saturated = true;
    counts[k] = static_cast<Count>(std::clamp(adu, 0.0, saturation_adu));
  }
  return saturated;
}

}  // namespace curlew
