#include "centroiding/systematic_error.h"

#include <algorithm>
#include <cstddef>

#include "core/as_size.h"
#include "core/size_check.h"

namespace curlew {
namespace {

/// Optics leave spots that telescopes blur off a smooth field by .06 to .08 of their σ.
constexpr float kSystematicOfBroadening = 0.08F;

/// Returns the part that lenslet k has in the variance of a cell's circulation, where it is the
/// first or last corner (`sign` −1) or another one (`sign` 1).
float part_in_cell(const SlopeField& slopes, std::size_t k, float sign) noexcept {
  return 0.25F * (slopes.variance_x[k] + slopes.variance_y[k]) +
         sign * 0.5F * slopes.covariance_xy[k];
}

}  // namespace

float systematic_part(const CellSample& sample, const SlopeField& slopes) noexcept {
  constexpr float kHalfWithin = 0.4549364F;  // the median of the square of a standard normal value
  constexpr float kPerhaps = 1.25F;          // standard deviations
  constexpr float kSurely = 2.5F;
  if (sample.n < CellSample::kFewest) return 1.0F;
  const std::size_t cols = as_size(slopes.cols());
  std::size_t beyond = 0;
  for (std::size_t i = 0; i < sample.n; ++i) {
    const std::size_t k = sample.lenslet[i];
    const float variance = part_in_cell(slopes, k, -1.0F) + part_in_cell(slopes, k + 1, 1.0F) +
                           part_in_cell(slopes, k + cols, 1.0F) +
                           part_in_cell(slopes, k + cols + 1, -1.0F);
    const float circulation = sample.circulation_rad[i];
    beyond += circulation * circulation > kHalfWithin * variance ? 1 : 0;
  }
  const float excess = sigmas_from_half(beyond, sample.n);
  return std::clamp((excess - kPerhaps) / (kSurely - kPerhaps), 0.0F, 1.0F);
}

void add_systematic_error(const SlopePlan& plan, const Centroids& centroids, float part,
                          SlopeField& slopes) noexcept {
  check_size("add_systematic_error", "centroids", size_of(centroids.state), size_of(slopes));
  if (!(part > 0.0F) || !(plan.systematic_variance_px2 > 0.0F)) return;
  const float of_all = part * plan.systematic_variance_px2;
  const float of_broadening = part * kSystematicOfBroadening * kSystematicOfBroadening;
  const float reference = plan.reference_variance_px2;
  const float xx = plan.m11 * plan.m11, xy = plan.m12 * plan.m12;
  const float yx = plan.m21 * plan.m21, yy = plan.m22 * plan.m22;
  const float cx = plan.m11 * plan.m21, cy = plan.m12 * plan.m22;
  const std::size_t n = slopes.x.size();
  const float* flux = centroids.flux_adu.data();
  const float* width_x = centroids.xx_px2.data();
  const float* width_y = centroids.yy_px2.data();
  const float* gain_x = plan.inverse_gain_x.data();
  const float* gain_y = plan.inverse_gain_y.data();
  const std::uint8_t* valid = slopes.valid.data();
  float* __restrict variance_x = slopes.variance_x.data();
  float* __restrict variance_y = slopes.variance_y.data();
  float* __restrict covariance = slopes.covariance_xy.data();
  const auto larger = [](float a, float b) { return a < b ? b : a; };
  for (std::size_t k = 0; k < n; ++k) {
    const float has_spot = ((valid[k] != 0) & (flux[k] > 0.0F)) ? 1.0F : 0.0F;
    const float broader_x = larger(width_x[k] - reference, 0.0F);
    const float broader_y = larger(width_y[k] - reference, 0.0F);
    const float x = has_spot * gain_x[k] * gain_x[k] * (of_all + of_broadening * broader_x);
    const float y = has_spot * gain_y[k] * gain_y[k] * (of_all + of_broadening * broader_y);
    variance_x[k] += xx * x + xy * y;
    variance_y[k] += yx * x + yy * y;
    covariance[k] += cx * x + cy * y;
  }
}

}  // namespace curlew
