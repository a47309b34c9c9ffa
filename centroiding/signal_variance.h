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
/// centred on T, .3408 s² is left). The estimate is
///     q = k·v + c·min(v/w, 1)²,  w = .73·√c + 1.3·k
/// A spot has far more pixels just below the threshold than just above it, and the square keeps
/// what noise lifts over the threshold from counting too much. w is fitted to the second moments of
/// sinc² and blurred spots of 2 to 3 px per λ/w with 75 to 20,000 electrons, Poisson and Gaussian
/// noise and whole counts. There, with T of 4 σ and read noises from .5 to 9 e⁻, the mean of q is 0
/// to 5 % below the variance where the spot has 20 electrons or more above T (σ includes whole
/// counts). What this lacks is in the widening of spot_finish-inl.h.
///
/// The kernel sums v and the remainder r = curve·min(v, w)², and puts q together afterwards. A flat
/// makes q larger by the gain; see CentroidPlan::mean_gain.
struct SignalVariance {
  float per_count = 0;  ///< k
  float width = 0;      ///< w, counts; 0 where nothing is known of the noise, and then r is 0
  float curve = 0;      ///< c/w²

  float remainder(float v) const noexcept {
    const float near = v < width ? v : width;
    return curve * near * near;
  }
};

inline SignalVariance variance_of_signal(const CentroidPlan& plan, float pixel_variance,
                                         float threshold) noexcept {
  const float k = plan.counts_per_e;
  const float c = threshold * k + pixel_variance;
  if (!(c > 0.0F)) return {.per_count = k};
  const float width = 0.73F * std::sqrt(c) + 1.3F * k;
  return {.per_count = k, .width = width, .curve = c / (width * width)};
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
