#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include "centroiding/slopes.h"
#include "core/error.h"

namespace curlew {
namespace {

/// This is the σ of a diffraction-limited spot's core, in λ/w. It is all that is known of a weak
/// spot whose few photons all fell on one row or column, so that they give a variance of 0.
constexpr double kSpotSigma = 0.42;

// This is the part of a spot's σ by which optics leave it off a smooth field. Lamps of real sensors
// show .025.
constexpr double kSystematicOfSpot = 0.03;

void require_length(double value, const std::string& name) {
  if (!(value > 0.0) || !std::isfinite(value)) {
    throw Failure("the sensor's " + name +
                  " is not known, so spots cannot be turned into radians; "
                  "calibrate again with it");
  }
}

/// Returns the map, or zeros of its size where a sensor has none.
Image<float> map_or_zeros(const Image<float>& map, const Image<std::uint8_t>& valid) {
  Image<float> values(valid.rows(), valid.cols());
  if (map.empty()) return values;
  for (std::size_t k = 0; k < values.size(); ++k)
    if (valid[k] != 0) values[k] = map[k];
  return values;
}

/// Returns SlopePlan::gain_error_x or gain_error_y; it is [rows, cols], and 0 where not valid. The
/// other maps are those of the plan along the axis.
Image<float> gain_error(const Image<float>& inverse_gain, const Image<float>& bend2,
                        const Image<float>& bend3, const Image<float>& off_px, float reach_px,
                        const Image<std::uint8_t>& valid) {
  Image<float> gain(valid.rows(), valid.cols());
  std::vector<float> sorted;
  for (std::size_t k = 0; k < gain.size(); ++k) {
    if (valid[k] == 0) continue;
    // This is the mean of the curve's derivative from −off − reach to −off + reach.
    const float off = off_px[k];
    const float mean = inverse_gain[k] - 2.0F * bend2[k] * off +
                       bend3[k] * (3.0F * off * off + reach_px * reach_px);
    gain[k] = 1.0F / std::max(mean, inverse_gain[k]);
    sorted.push_back(gain[k]);
  }
  Image<float> error(gain.rows(), gain.cols());
  if (sorted.empty()) return error;
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
  std::nth_element(sorted.begin(), middle, sorted.end());
  for (std::size_t k = 0; k < gain.size(); ++k) {
    if (valid[k] != 0) error[k] = 0.5F * std::max(0.0F, 1.0F - gain[k] / *middle);
  }
  return error;
}

}  // namespace

SlopePlan::SlopePlan(const Sensor& sensor)
    : sampling(sensor),
      ref_x_px(sensor.valid.rows(), sensor.valid.cols()),
      ref_y_px(sensor.valid.rows(), sensor.valid.cols()),
      inverse_gain_x(sensor.valid.rows(), sensor.valid.cols()),
      inverse_gain_y(sensor.valid.rows(), sensor.valid.cols()),
      is_bent(!sensor.bend2_x.empty()),
      bend2_x(map_or_zeros(sensor.bend2_x, sensor.valid)),
      bend2_y(map_or_zeros(sensor.bend2_y, sensor.valid)),
      bend3_x(map_or_zeros(sensor.bend3_x, sensor.valid)),
      bend3_y(map_or_zeros(sensor.bend3_y, sensor.valid)),
      off_x_px(sensor.valid.rows(), sensor.valid.cols()),
      off_y_px(sensor.valid.rows(), sensor.valid.cols()) {
  require_length(sensor.optics.pitch_m, "lenslet pitch");
  require_length(sensor.optics.focal_m, "focal length");
  require_length(sensor.optics.pixel_m, "pixel size");
  require_length(sensor.optics.wavelength_m, "wavelength");
  require_length(sensor.optics.magnification, "magnification");
  const double determinant = sensor.grid.determinant();
  if (!std::isfinite(determinant) || determinant == 0.0) {
    throw Failure("the sensor's lenslet grid has no area; calibrate again");
  }
  const double scale = sensor.optics.slope_rad_per_px() * sensor.grid.pitch_px() / determinant;
  m11 = static_cast<float>(scale * sensor.grid.p22);
  m12 = static_cast<float>(-scale * sensor.grid.p12);
  m21 = static_cast<float>(-scale * sensor.grid.p21);
  m22 = static_cast<float>(scale * sensor.grid.p11);
  reach_px = static_cast<float>(curve_reach_px(sensor));

  for (std::size_t k = 0; k < sensor.valid.size(); ++k) {
    if (sensor.valid[k] == 0) continue;
    const bool usable = std::isfinite(sensor.ref_x_px[k]) && std::isfinite(sensor.ref_y_px[k]) &&
                        sensor.gain_x[k] > 0.0F && sensor.gain_y[k] > 0.0F &&
                        std::isfinite(sensor.gain_x[k]) && std::isfinite(sensor.gain_y[k]);
    if (!usable) {
      const auto cols = static_cast<std::size_t>(sensor.valid.cols());
      throw Failure("lenslet (" + std::to_string(k / cols) + ", " + std::to_string(k % cols) +
                    ") is marked valid but has no reference or gain; calibrate again");
    }
    ref_x_px[k] = sampling.true_px(sensor.ref_x_px[k]);
    ref_y_px[k] = sampling.true_px(sensor.ref_y_px[k]);
    const Window& window = sensor.window[k];
    off_x_px[k] = static_cast<float>(
        off_middle_px(static_cast<double>(sensor.ref_x_px[k]), window.x0, window.w));
    off_y_px[k] = static_cast<float>(
        off_middle_px(static_cast<double>(sensor.ref_y_px[k]), window.y0, window.h));
    inverse_gain_x[k] = 1.0F / sensor.gain_x[k];
    inverse_gain_y[k] = 1.0F / sensor.gain_y[k];
  }
  set_variances(sensor);
  gain_error_x = gain_error(inverse_gain_x, bend2_x, bend3_x, off_x_px, reach_px, sensor.valid);
  gain_error_y = gain_error(inverse_gain_y, bend2_y, bend3_y, off_y_px, reach_px, sensor.valid);
  if (sampling.empty()) return;
  // The sampling curve is all that keeps small spots' centres of gravity from where they lie.
  is_bent = false;
  for (Image<float>* gain : {&inverse_gain_x, &inverse_gain_y})
    for (float& value : *gain) value = value != 0.0F ? 1.0F : 0.0F;
}

void SlopePlan::set_variances(const Sensor& sensor) {
  window_variance = Image<float>(sensor.valid.rows(), sensor.valid.cols());
  const double rad_per_px = sensor.optics.slope_rad_per_px();
  const double spot_sigma_px = kSpotSigma * 2.0 * std::numbers::pi / rad_per_px;
  spot_variance_px2 = static_cast<float>(spot_sigma_px * spot_sigma_px);
  const bool known = std::isfinite(sensor.spot_sigma_px);
  const double sigma_px = known ? sensor.spot_sigma_px : 0.0;
  systematic_variance_px2 = static_cast<float>(std::pow(kSystematicOfSpot * sigma_px, 2.0));
  reference_variance_px2 =
      known ? static_cast<float>(sigma_px * sigma_px) : std::numeric_limits<float>::infinity();
  for (std::size_t k = 0; k < window_variance.size(); ++k) {
    const double side_rad = rad_per_px * std::max(sensor.window[k].w, sensor.window[k].h);
    window_variance[k] = static_cast<float>(side_rad * side_rad / 12.0);
  }
}

}  // namespace curlew
