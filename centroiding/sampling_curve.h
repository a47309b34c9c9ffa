// Where the centre of gravity of a spot lies that is smaller than the pixels.
#pragma once

#include <vector>

#include "centroiding/sensor.h"
#include "core/image.h"

namespace curlew {

/// The centre of gravity of a spot of a pixel or less is drawn to the pixels' middles: for a
/// Gaussian of σ px, integrated over pixels, it is off by up to exp(−2π²σ²)/π px. The curve takes
/// that back. It depends on where in its pixel a centre of gravity lies, and is the same for all
/// spots.
class SamplingCurve {
 public:
  /// Without a curve, true_px() gives back what it gets.
  SamplingCurve() = default;

  /// Makes the curve for Sensor::spot_gaussian_px. There is none where spots are wide enough not to
  /// need one, or nothing is known of them.
  explicit SamplingCurve(const Sensor& sensor);

  bool empty() const noexcept { return correction_px_.empty(); }

  /// Returns where the spot lies whose centre of gravity is at this column or row of the frame.
  float true_px(float centre_px) const noexcept;

 private:
  std::vector<float> correction_px_;  ///< from −½ to ½ px from a pixel's middle, in equal steps
};

/// Returns Sensor::spot_gaussian_px: σ such that the second moments of the 5×5 pixels about the
/// brightest, on average over the sensor's spots, are those of a Gaussian. `light` is the reference
/// above its level. NaN where there is no such σ below a pixel.
double fit_spot_gaussian_px(const Image<float>& light, const Sensor& sensor);

}  // namespace curlew
