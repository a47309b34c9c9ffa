// How much wider the spots of a reference are than diffraction makes them.
#pragma once

#include "centroiding/sensor.h"
#include "core/image.h"

namespace curlew {

/// Returns the σ in px of the Gaussian that widens the core of a SpotProfile, between equally
/// bright neighbours, to the core of the reference spots. `light` holds them without level; optics,
/// grid, windows and reference positions must be known. NaN where diffraction has less than half a
/// pixel a λ/w, or where no spot has light. Wider blurs than 3 λ/w are not told apart.
double fit_spot_blur_px(const Sensor& sensor, const Image<float>& light);

}  // namespace curlew
