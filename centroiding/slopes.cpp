#include "centroiding/slopes.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include "core/error.h"
#include "core/size_check.h"

namespace curlew {
namespace {

/// This is the σ of a diffraction-limited spot's core, in λ/w. It is all that is known of a weak
/// spot whose few photons all fell on one row or column, so that they give a variance of 0.
constexpr double kSpotSigma = 0.42;

// These are the parts of a spot's σ by which optics leave it off a smooth field. Lamps of real
// sensors show .025, and spots that telescopes blur show .06 to .08.
constexpr double kSystematicOfSpot = 0.03;
constexpr float kSystematicOfBroadening = 0.08F;

void require_length(double value, const std::string& name) {
  if (!(value > 0.0) || !std::isfinite(value)) {
    throw Failure("the sensor's " + name +
                  " is not known, so spots cannot be turned into radians; "
                  "calibrate again with it");
  }
}

/// Returns SlopePlan::gain_error_x or gain_error_y; it is [rows, cols], and 0 where not valid.
Image<float> gain_error(const Image<float>& gain, const Image<std::uint8_t>& valid) {
  std::vector<float> sorted;
  for (std::size_t k = 0; k < gain.size(); ++k) {
    if (valid[k] != 0) sorted.push_back(gain[k]);
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
      inverse_gain_y(sensor.valid.rows(), sensor.valid.cols()) {
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
    // The curve is all that keeps small spots' centres of gravity from where the spots lie.
    inverse_gain_x[k] = sampling.empty() ? 1.0F / sensor.gain_x[k] : 1.0F;
    inverse_gain_y[k] = sampling.empty() ? 1.0F / sensor.gain_y[k] : 1.0F;
  }
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
  gain_error_x = gain_error(sensor.gain_x, sensor.valid);
  gain_error_y = gain_error(sensor.gain_y, sensor.valid);
}

namespace {

enum class Spot : std::uint8_t { kMissing, kDark, kWeak, kMeasured };

/// Returns the variance along an axis, px², of where optics leave a spot of this second moment.
float systematic_variance(const SlopePlan& plan, float moment_px2) noexcept {
  constexpr float kOfBroadening = kSystematicOfBroadening * kSystematicOfBroadening;
  const float broader = std::max(moment_px2 - plan.reference_variance_px2, 0.0F);
  return plan.systematic_variance_px2 + kOfBroadening * broader;
}

/// Computes all slopes; spot_of(k) says what is known of lenslet k.
template <typename SpotOf>
void measure(const SlopePlan& plan, const Centroids& centroids, SlopeField& slopes,
             SpotOf spot_of) noexcept {
  check_size("measure_slopes", "centroids", size_of(centroids.state), size_of(plan.ref_x_px));
  check_size("measure_slopes", "slopes", size_of(slopes), size_of(plan.ref_x_px));
  // These are locals, because a store through a float pointer might otherwise change the plan's
  // floats.
  const float m11 = plan.m11, m12 = plan.m12, m21 = plan.m21, m22 = plan.m22;
  const bool sampled = plan.sampling.empty();
  int n_valid = 0;
  for (std::size_t k = 0; k < plan.ref_x_px.size(); ++k) {
    const Spot spot = spot_of(k);
    const bool measured = spot == Spot::kMeasured || spot == Spot::kWeak;
    const bool weak = spot == Spot::kWeak;
    const float spot_x = centroids.variance_x_px2[k];
    const float spot_y = centroids.variance_y_px2[k];
    const float gx = measured ? plan.inverse_gain_x[k] : 0.0F;
    const float gy = measured ? plan.inverse_gain_y[k] : 0.0F;
    // The gain is that of the window, so it applies to the displacement within the window. A dark
    // lenslet's spot is most likely where those of the others are.
    const float moved_x = measured ? centroids.moved_x_px[k] : 0.0F;
    const float moved_y = measured ? centroids.moved_y_px[k] : 0.0F;
    const float x_px = sampled ? centroids.x_px[k] : plan.sampling.true_px(centroids.x_px[k]);
    const float y_px = sampled ? centroids.y_px[k] : plan.sampling.true_px(centroids.y_px[k]);
    const float in_window_x = (x_px - plan.ref_x_px[k] - moved_x) * gx;
    const float in_window_y = (y_px - plan.ref_y_px[k] - moved_y) * gy;
    const bool is_dark = spot == Spot::kDark;
    const float dx = in_window_x + (is_dark ? centroids.low_x_px[k] : moved_x);
    const float dy = in_window_y + (is_dark ? centroids.low_y_px[k] : moved_y);
    const float ex = plan.gain_error_x[k] * in_window_x;
    const float ey = plan.gain_error_y[k] * in_window_y;
    const float noise_x = weak && !(spot_x > 0.0F) ? plan.spot_variance_px2 : spot_x;
    const float noise_y = weak && !(spot_y > 0.0F) ? plan.spot_variance_px2 : spot_y;
    const float vx = (noise_x + systematic_variance(plan, centroids.xx_px2[k])) * gx * gx + ex * ex;
    const float vy = (noise_y + systematic_variance(plan, centroids.yy_px2[k])) * gy * gy + ey * ey;
    const float c = centroids.covariance_xy_px2[k] * gx * gy;
    const float dark = is_dark ? plan.window_variance[k] : 0.0F;
    slopes.x[k] = m11 * dx + m12 * dy;
    slopes.y[k] = m21 * dx + m22 * dy;
    const float variance_x = m11 * m11 * vx + 2.0F * m11 * m12 * c + m12 * m12 * vy;
    const float variance_y = m21 * m21 * vx + 2.0F * m21 * m22 * c + m22 * m22 * vy;
    const float covariance = m11 * m21 * vx + (m11 * m22 + m12 * m21) * c + m12 * m22 * vy;
    // A weak spot cannot be less well known than a dark one, which may be anywhere in its window.
    const float maximum = plan.window_variance[k];
    const bool lost = weak && std::max(variance_x, variance_y) > maximum;
    slopes.variance_x[k] = dark + (lost ? std::min(variance_x, maximum) : variance_x);
    slopes.variance_y[k] = dark + (lost ? std::min(variance_y, maximum) : variance_y);
    slopes.covariance_xy[k] = lost ? 0.0F : covariance;
    slopes.valid[k] = spot == Spot::kMissing ? 0 : 1;
    n_valid += spot == Spot::kMissing ? 0 : 1;
  }
  slopes.n_valid = n_valid;
}

}  // namespace

void measure_slopes(const SlopePlan& plan, const Centroids& centroids,
                    SlopeField& slopes) noexcept {
  measure(plan, centroids, slopes, [&](std::size_t k) {
    return centroids.state[k] == LensletState::kValid ? Spot::kMeasured : Spot::kMissing;
  });
}

void measure_weak_slopes(const SlopePlan& plan, const Centroids& centroids,
                         SlopeField& slopes) noexcept {
  measure(plan, centroids, slopes, [&](std::size_t k) {
    const LensletState state = centroids.state[k];
    if (state == LensletState::kValid) return Spot::kMeasured;
    if (state != LensletState::kFaint && state != LensletState::kAtEdge) return Spot::kMissing;
    return centroids.flux_adu[k] > 0.0F ? Spot::kWeak : Spot::kDark;
  });
}

void leave_out_weak(const Centroids& centroids, const SlopeField& weak,
                    SlopeField& slopes) noexcept {
  check_size("leave_out_weak", "centroids", size_of(centroids.state), size_of(weak));
  check_size("leave_out_weak", "slopes", size_of(slopes), size_of(weak));
  int n_valid = 0;
  for (std::size_t k = 0; k < weak.x.size(); ++k) {
    const bool valid = centroids.state[k] == LensletState::kValid;
    slopes.x[k] = valid ? weak.x[k] : 0.0F;
    slopes.y[k] = valid ? weak.y[k] : 0.0F;
    slopes.variance_x[k] = valid ? weak.variance_x[k] : 0.0F;
    slopes.variance_y[k] = valid ? weak.variance_y[k] : 0.0F;
    slopes.covariance_xy[k] = valid ? weak.covariance_xy[k] : 0.0F;
    slopes.valid[k] = valid ? 1 : 0;
    n_valid += valid ? 1 : 0;
  }
  slopes.n_valid = n_valid;
}

void subtract_low_orders(const SlopePlan& plan, const Centroids& centroids,
                         SlopeField& slopes) noexcept {
  check_size("subtract_low_orders", "centroids", size_of(centroids.state), size_of(plan.ref_x_px));
  check_size("subtract_low_orders", "slopes", size_of(slopes), size_of(plan.ref_x_px));
  const float m11 = plan.m11, m12 = plan.m12, m21 = plan.m21, m22 = plan.m22;
  for (std::size_t k = 0; k < slopes.x.size(); ++k) {
    const float x = slopes.valid[k] != 0 ? centroids.low_x_px[k] : 0.0F;
    const float y = slopes.valid[k] != 0 ? centroids.low_y_px[k] : 0.0F;
    slopes.x[k] -= m11 * x + m12 * y;
    slopes.y[k] -= m21 * x + m22 * y;
  }
}

}  // namespace curlew
