// The light of simulated fields behind optics that are not sharp.
#pragma once

#include "core/image.h"
#include "service/bench/detection_dataset.h"

namespace curlew {

/// Returns the light of a frame after a Gaussian blur of sigma_px. The light must hold nothing
/// beyond half a cycle a pixel, as the light of pixels of .5 λ/w or finer does; then the blur is
/// right to .4 % of the light, however narrow. Light that is blurred over the frame's rim is lost.
Image<float> blurred(const Image<float>& light, double sigma_px);

/// Returns the parameters of the finer and wider light that turned() needs.
FieldParameters before_turning(const FieldParameters& parameters);

/// Returns what pixels see that are turned against the lenslets, as parameters.rotation_deg says;
/// `light` is that of before_turning(parameters). Each window has a lenslet's own light alone.
Image<float> turned(const Image<float>& light, const FieldParameters& parameters);

}  // namespace curlew
