#include "service/bench/detection_measurement.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <numbers>

#include "acquisition/simulator/random_stream.h"
#include "acquisition/simulator/simulator.h"
#include "core/error.h"
#include "detect/circulation.h"
#include "service/bench/bench_frames.h"
#include "service/bench/field_light.h"

namespace curlew {
namespace {

constexpr double kBiasAdu = 100.0;
constexpr double kSaturationAdu = 65535.0;
constexpr double kNoiseFreePeakAdu = 60000.0;
constexpr double kGainTilt = 0.25;                // rad a pitch
constexpr std::uint64_t kFadingStream = 0xfaded;  // number of a random stream that no flux has

/// Chooses the gain. With 2e-4·photons electrons an ADU, 16 bits hold 13 times what a lenslet of
/// amplitude 1 gathers, and no pixel gets as much.
double choose_e_per_adu(double photons, double read_noise_e) {
  const double fine = read_noise_e > 0.0 ? 0.25 * read_noise_e : 0.25;
  return std::max(fine, 2e-4 * photons);
}

const FieldParameters& checked(const FieldParameters& parameters,
                               const MeasurementOptions& options) {
  if (!(options.photons > 0.0)) throw UsageError("photons a lenslet must be more than 0");
  if (!(options.read_noise_e >= 0.0 && options.threshold_noise >= 0.0))
    throw UsageError("read noise and threshold must be 0 or more");
  if (!(options.blur >= 0.0 && options.blur <= 3.0))
    throw UsageError("the blur must be from 0 to 3 lambda/w");
  if (!(options.sky_e >= 0.0) || (options.sky_e > 0.0 && !std::isfinite(options.photons)))
    throw UsageError("the sky must be 0 electrons or more, and needs noise: state the photons");
  if (!(options.faded >= 0.0 && options.faded < 1.0))
    throw UsageError("the part of faded lenslets must be from 0 to below 1");
  if (parameters.rows < 4 || parameters.cols < 4)
    throw UsageError("detection is measured on 4 x 4 lenslets or more");
  return parameters;
}

/// Takes the lenslets outside the pupil from the sensor.
void cover(Sensor& sensor, const Image<std::uint8_t>& pupil) {
  for (std::size_t k = 0; k < pupil.size(); ++k) {
    if (pupil[k] != 0) continue;
    sensor.valid[k] = 0;
    sensor.window[k] = {};
    sensor.ref_x_px[k] = sensor.ref_y_px[k] = std::numeric_limits<float>::quiet_NaN();
  }
}

/// Returns the light without that of lenslets outside the pupil or faded.
Image<float> shade(const MeasurementPlan& plan, const Image<float>& light, std::uint64_t seed) {
  Image<float> left = light;
  const int window = plan.parameters().window_px;
  const Image<std::uint8_t>& pupil = plan.sensor().valid;
  RandomStream random(seed, kFadingStream);
  for (int row = 0; row < pupil.rows(); ++row) {
    for (int col = 0; col < pupil.cols(); ++col) {
      const bool faded = random.uniform() < plan.options().faded;
      if (pupil(row, col) != 0 && !faded) continue;
      for (int i = row * window; i < (row + 1) * window; ++i)
        std::fill_n(&left(i, col * window), window, 0.0F);
    }
  }
  return left;
}

/// Returns a mask, [rows, cols], that is 1 where a lenslet lies in the pupil.
Image<std::uint8_t> pupil_mask(PupilShape shape, int rows, int cols) {
  SimulatorOptions simulated;
  simulated.rows = rows;
  simulated.cols = cols;
  simulated.pupil = shape;
  return find_lit_lenslets(simulated);
}

}  // namespace

MeasurementPlan::MeasurementPlan(const FieldParameters& parameters,
                                 const MeasurementOptions& options)
    : parameters_(checked(parameters, options)),
      options_(options),
      noisy_(std::isfinite(options.photons)),
      e_per_adu_(noisy_ ? choose_e_per_adu(options.photons, options.read_noise_e) : kUnknown),
      split_(Image<std::uint8_t>(parameters.rows, parameters.cols, 1), {}) {
  format_.rows = parameters.rows * parameters.window_px;
  format_.cols = parameters.cols * parameters.window_px;
  CentroidOptions centroid;
  centroid.method = options.method;
  centroid.threshold_noise = options.threshold_noise;
  centroid.spot_sigma_px = options.spot_sigma_px;
  centroid.reference_pull = options.reference_pull;
  centroid.brightest_pixels = options.brightest_pixels;
  centroid.min_snr = 0.0;
  centroid.edge_fraction = 0.0;
  centroid_.emplace(make_sensor(1.0), format_, centroid);
  sensor_ = make_sensor(measure_gain());
  if (options.pupil != PupilShape::kSquare) {
    cover(sensor_, pupil_mask(options.pupil, parameters.rows, parameters.cols));
    centroid_.emplace(sensor_, format_, centroid);
  }
  slopes_.emplace(sensor_);
  if (options.sky_e > 0.0) level_.emplace(sensor_, *centroid_, centroid);
}

Image<float> MeasurementPlan::blur(const Image<float>& light) const {
  return blurred(light, options_.blur * parameters_.samples_per_lambda_w);
}

double MeasurementPlan::flux_unit_adu() const {
  return noisy_ ? options_.photons / e_per_adu_ : 1.0;
}

Sensor MeasurementPlan::make_sensor(double gain) const {
  const auto& p = parameters_;
  Sensor sensor = tiled_sensor({p.rows, p.cols, p.window_px});
  // One pixel is 2π/samples_per_lambda_w rad a pitch. Only the ratio of these lengths counts.
  sensor.optics = {.pitch_m = 1e-4,
                   .focal_m = 1e-2,
                   .pixel_m = 1e-5,
                   .wavelength_m = 1e-4 * 1e-5 * p.samples_per_lambda_w / 1e-2,
                   .magnification = 1.0,
                   .mirrored = false};
  sensor.detector = {.e_per_adu = e_per_adu_,
                     .read_noise_e = noisy_ ? options_.read_noise_e : 0.0,
                     .saturation_adu = kUnknown,
                     .bit_depth = 16};
  const double angle = p.rotation_deg * std::numbers::pi / 180.0;
  sensor.grid.p11 = sensor.grid.p22 = p.window_px * std::cos(angle);
  sensor.grid.p21 = p.window_px * std::sin(angle);
  sensor.grid.p12 = -sensor.grid.p21;
  sensor.background_adu = kBiasAdu;
  sensor.spot_blur_px = options_.blur * p.samples_per_lambda_w;
  sensor.method = options_.method;
  sensor.gain_x.fill(static_cast<float>(gain));
  sensor.gain_y.fill(static_cast<float>(gain));
  return sensor;
}

namespace {

/// Makes the counts of a frame without noise. Every window gets a scale of its own.
void expose_without_noise(const MeasurementPlan& plan, const Image<float>& light,
                          FrameBuffer& frame, Image<float>& scale) {
  auto* counts = reinterpret_cast<std::uint16_t*>(frame.data());
  const int window = plan.parameters().window_px;
  for (int row = 0; row < scale.rows(); ++row) {
    for (int col = 0; col < scale.cols(); ++col) {
      float peak = 0.0F;
      const auto for_each_pixel = [&](auto&& use) {
        for (int i = row * window; i < (row + 1) * window; ++i)
          for (int j = col * window; j < (col + 1) * window; ++j) use(i, j);
      };
      for_each_pixel([&](int i, int j) { peak = std::max(peak, light(i, j)); });
      scale(row, col) = peak > 0.0F ? static_cast<float>(kNoiseFreePeakAdu) / peak : 1.0F;
      for_each_pixel([&](int i, int j) {
        counts[i * light.cols() + j] = static_cast<std::uint16_t>(
            std::lround(kBiasAdu + static_cast<double>(light(i, j) * scale(row, col))));
      });
    }
  }
}

void expose_with_noise(const MeasurementPlan& plan, const Image<float>& light, std::uint64_t seed,
                       FrameBuffer& frame) {
  const MeasurementOptions& options = plan.options();
  // Neither the screens of this seed nor another flux use this random stream.
  RandomStream random(~seed, std::bit_cast<std::uint64_t>(options.photons));
  auto* counts = reinterpret_cast<std::uint16_t*>(frame.data());
  const double adu_per_e = plan.flux_unit_adu() / options.photons;
  for (std::size_t k = 0; k < light.size(); ++k) {
    const double mean_e = options.photons * static_cast<double>(light[k]) + options.sky_e;
    const double electrons = random.poisson(mean_e) + options.read_noise_e * random.gaussian();
    const double adu = std::floor(kBiasAdu + electrons * adu_per_e + 0.5);
    counts[k] = static_cast<std::uint16_t>(std::clamp(adu, 0.0, kSaturationAdu));
  }
}

/// Gives lenslets without a centroid a slope, see MeasuredFrame::slopes.
void fill_missing(const MeasurementPlan& plan, SlopeField& slopes) {
  const auto& p = plan.parameters();
  const double window_rad = 2.0 * std::numbers::pi * p.window_px / p.samples_per_lambda_w;
  const auto variance = static_cast<float>(window_rad * window_rad / 12.0);
  for (std::size_t k = 0; k < slopes.valid.size(); ++k) {
    if (slopes.valid[k] != 0) continue;
    slopes.valid[k] = 1;
    slopes.variance_x[k] = slopes.variance_y[k] = variance;
    ++slopes.n_valid;
  }
}

}  // namespace

// The gain is the displacement between the spots of two plane waves tilted along x, over the true
// displacement.
double MeasurementPlan::measure_gain() const {
  SimulatorOptions options = simulator_options(parameters_, 0);
  options.turbulence.reset();
  FrameBuffer frame(format_);
  Centroids centroids(parameters_.rows, parameters_.cols);
  const auto mean_x = [&](double tilt) {
    options.scene.tilt_x_rad = tilt;
    Simulator simulator(options);
    const Image<float>& sharp = simulator.expected_image_e(0);
    const Image<float> light = options_.blur > 0.0 ? blur(sharp) : sharp;
    if (noisy_) {
      auto* counts = reinterpret_cast<std::uint16_t*>(frame.data());
      for (std::size_t k = 0; k < light.size(); ++k) {
        const double adu = kBiasAdu + static_cast<double>(light[k]) * flux_unit_adu();
        counts[k] = static_cast<std::uint16_t>(std::lround(std::min(adu, kSaturationAdu)));
      }
    } else {
      Image<float> scale(parameters_.rows, parameters_.cols);
      expose_without_noise(*this, light, frame, scale);
    }
    find_centroids(*centroid_, frame.view(), centroids);
    double sum = 0.0;
    for (const float x : centroids.x_px) sum += static_cast<double>(x);
    return centroids.n_valid == static_cast<int>(centroids.x_px.size())
               ? sum / static_cast<double>(centroids.x_px.size())
               : 0.0;
  };
  const double moved_px = mean_x(kGainTilt) - mean_x(-kGainTilt);
  const double true_px =
      2.0 * kGainTilt * parameters_.samples_per_lambda_w / (2.0 * std::numbers::pi);
  const double gain = moved_px / true_px;
  if (!(gain > 0.05)) {
    throw UsageError(
        "a plane wave's spots cannot be measured: the window or the photons are too few; raise "
        "them, or lower the threshold");
  }
  return gain;
}

MeasuredFrame::MeasuredFrame(const MeasurementPlan& plan)
    : frame(plan.format()),
      centroids(plan.parameters().rows, plan.parameters().cols),
      slopes(plan.parameters().rows, plan.parameters().cols),
      circulation(plan.parameters().rows, plan.parameters().cols),
      split_workspace(plan.split()),
      split(plan.parameters().rows, plan.parameters().cols) {
  if (plan.level()) levels.emplace(*plan.level());
}

FrameShift MeasuredFrame::shift() const {
  if (!levels) return {};
  return {.level_counts = &levels->level, .noise_counts = std::sqrt(levels->pixel_variance)};
}

void measure_frame(const MeasurementPlan& plan, const Realisation& realisation, std::uint64_t seed,
                   MeasuredFrame& measured) {
  const bool shaded = plan.options().pupil != PupilShape::kSquare || plan.options().faded > 0.0;
  const Image<float> left = shaded ? shade(plan, realisation.light, seed) : Image<float>();
  const Image<float>& sharp = shaded ? left : realisation.light;
  const Image<float> wide = plan.options().blur > 0.0 ? plan.blur(sharp) : Image<float>();
  const Image<float>& light = plan.options().blur > 0.0 ? wide : sharp;
  if (plan.noisy()) {
    expose_with_noise(plan, light, seed, measured.frame);
    if (measured.levels) {
      measure_levels(*plan.level(), plan.level()->pixels(), measured.frame.view(),
                     *measured.levels);
      find_centroids(plan.centroid(), measured.frame.view(), measured.centroids,
                     {&*measured.levels, nullptr});
    } else {
      find_centroids(plan.centroid(), measured.frame.view(), measured.centroids);
    }
  } else {
    Image<float> scale(plan.parameters().rows, plan.parameters().cols);
    expose_without_noise(plan, light, measured.frame, scale);
    find_centroids(plan.centroid(), measured.frame.view(), measured.centroids);
    for (std::size_t k = 0; k < scale.size(); ++k) measured.centroids.flux_adu[k] /= scale[k];
  }
  measure_slopes(plan.slopes(), measured.centroids, measured.slopes);
  fill_missing(plan, measured.slopes);
  circulate(measured.slopes, measured.circulation);
  split_slopes(plan.split(), measured.slopes, measured.split_workspace, measured.split);
}

}  // namespace curlew
