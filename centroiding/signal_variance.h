// This file says how noisy a thresholded signal is.
#pragma once

#include <cmath>
#include <cstddef>

#include "centroiding/centroid.h"
#include "centroiding/frame_level.h"

namespace curlew {

/// This model estimates the variance of a thresholded signal v = max(I − T, 0) from v itself. Far
/// above the threshold the variance is v·k + c with c = T·k + σ², where k is the counts per
/// electron. Near the threshold, clipping takes most of it away (for Gaussian noise of variance s²
/// centred on T, .3408 s² is left). The estimate
///     q = k·v + slope·min(v, w),  slope = c/w
/// has the right mean, for Poisson plus Gaussian noise, when averaged over pixels of any brightness
/// with w = u·(1 + k·u/(3c)) and u = .85·√c + k, which is 1 electron (within 1 % for T from 1.5 to
/// 20 σ and σ from .5 to 10 e⁻, by Monte Carlo). It uses a ramp rather than a step because whole
/// counts of about an electron make steps coarse, and because a ramp scatters less.
///
/// The kernel sums v and the remainder r = slope·min(v, w), and puts q together afterwards. A flat
/// makes q larger by the gain; see CentroidPlan::mean_gain.
struct SignalVariance {
  float per_count = 0;  ///< k
  float width = 0;      ///< w, counts; 0 where nothing is known of the noise, and then r is 0
  float slope = 0;

  float remainder(float v) const noexcept { return slope * (v < width ? v : width); }
};

inline SignalVariance variance_of_signal(const CentroidPlan& plan, float pixel_variance,
                                         float threshold) noexcept {
  const float k = plan.counts_per_e;
  const float c = threshold * k + pixel_variance;
  const float u = 0.85F * std::sqrt(c) + k;
  if (!(u > 0.0F && c > 0.0F)) return {.per_count = k};
  const float width = u * (1.0F + k * u / (3.0F * c));
  return {.per_count = k, .width = width, .slope = c / width};
}

/// What the frame at hand says of its pixels, or else the calibration.
struct PixelModel {
  PixelModel(const CentroidPlan& plan, const FrameLevels* levels, float relative) noexcept
      : relative_threshold(relative),
        level(levels != nullptr ? levels->level.data() : nullptr),
        threshold(levels != nullptr ? levels->threshold : plan.threshold),
        pixel_variance(levels != nullptr ? levels->pixel_variance : plan.pixel_variance),
        signal(variance_of_signal(plan, pixel_variance, threshold)) {}

  /// How far lenslet k's threshold lies above that in the plan's offsets, in counts.
  float raised(const CentroidPlan& plan, std::size_t k) const noexcept {
    return level != nullptr ? level[k] + (threshold - plan.threshold) : 0.0F;
  }

  float relative_threshold;  ///< as a part of the window's brightest pixel; 0 for none
  const float* level;        ///< [lenslets] above the calibration's dark; null: the calibration's
  float threshold;           ///< T without the relative threshold, counts
  float pixel_variance;      ///< counts²
  SignalVariance signal;
};

}  // namespace curlew
