// This file says how noisy a thresholded signal is.
#pragma once

#include <cmath>
#include <cstddef>

#include "centroiding/centroid.h"
#include "centroiding/frame_level.h"

namespace curlew {

/// This model estimates the variance of a thresholded signal v = max(I − T, 0) from v itself. Far
/// above the threshold the variance is (v + T)·k + σ², where k is the counts per electron. Near the
/// threshold, clipping takes most of it away (for Gaussian noise of variance s² centred on T, .3408
/// s² is left). The estimate
///     q = (v·k + c)·min(v/w, 1),  c = T·k + σ²
/// has the right mean, for Poisson plus Gaussian noise, when averaged over pixels of any brightness
/// with w = .85·√(c k⁻²) + 1 electron (fitted to within 10 % for T from 1.5 to 20 σ and σ from
/// .5 to 10 e⁻, which is 1.5 % of a spot's variance). It uses a ramp rather than a step because
/// whole counts of about an electron make steps coarse, and because a ramp scatters less.
///
/// The kernel sums v and a remainder r, which only depends on u = min(v, w):
///     q = k·v + r,  r = u·(a·u + b),  a = k/w,  b = c/w − k
/// A flat of mean 1 over a window changes neither; see CentroidPlan::mean_gain.
struct SignalVariance {
  float per_count = 0;  ///< k
  float width = 0;      ///< w, counts; 0 where nothing is known of the noise, and then r is 0
  float square = 0;     ///< a
  float linear = 0;     ///< b

  float remainder(float v) const noexcept {
    const float u = v < width ? v : width;
    return u * (square * u + linear);
  }
};

inline SignalVariance variance_of_signal(const CentroidPlan& plan, float pixel_variance,
                                         float threshold) noexcept {
  const float k = plan.counts_per_e;
  const float c = threshold * k + pixel_variance;
  const float width = 0.85F * std::sqrt(c) + k;
  if (!(width > 0.0F)) return {.per_count = k};
  return {.per_count = k, .width = width, .square = k / width, .linear = c / width - k};
}

/// What the frame at hand says of its pixels, or else the calibration.
struct PixelModel {
  PixelModel(const CentroidPlan& plan, const FrameLevels* levels) noexcept
      : level(levels != nullptr ? levels->level.data() : nullptr),
        threshold(levels != nullptr ? levels->threshold : plan.threshold),
        pixel_variance(levels != nullptr ? levels->pixel_variance : plan.pixel_variance),
        signal(variance_of_signal(plan, pixel_variance, threshold)) {}

  /// How far lenslet k's threshold lies above that in the plan's offsets, in counts.
  float raised(const CentroidPlan& plan, std::size_t k) const noexcept {
    return level != nullptr ? level[k] + (threshold - plan.threshold) : 0.0F;
  }

  const float* level;    ///< [lenslets] above the calibration's dark; null: the calibration's
  float threshold;       ///< T without the relative threshold, counts
  float pixel_variance;  ///< counts²
  SignalVariance signal;
};

}  // namespace curlew
