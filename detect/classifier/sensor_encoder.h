// This file declares how the encoder of spots learns of the sensor: by blur, pixels, windows and
// rotation, all of which go into its weights when the plan is made.
#pragma once

#include <array>

#include "detect/classifier/classifier_network.h"
#include "detect/classifier/spot_features.h"

namespace curlew {

/// Says what all spots of a sensor have in common. Lengths are in units of λ/w.
struct SensorTraits {
  double blur = 0.0;   ///< σ of the blur beyond diffraction and pixels
  double pixel = 0.5;  ///< side of a pixel
  double reach = 1.5;  ///< half the side of the part of a window that is looked at
};

/// Returns the traits of a camera.
SensorTraits traits_of(const SpotCamera& camera);

/// Returns the factors of the blocks of the encoder's inputs: 1, then twice the blur and its
/// square, and one that grows with the pixels. Input f of block b is factor b times feature f. One
/// more input, reach_input(), follows. For the sensor of the benchmark all but the first are 0.
std::array<float, kTraitBlocks> trait_factors(const SensorTraits& traits);
float reach_input(const SensorTraits& traits);

/// Returns by how much the spots' second moments, xx + yy, exceed those of the benchmark's sensor,
/// in (λ/w)².
float excess_spread(const SensorTraits& traits);

/// Returns the encoder's first layer for one sensor, which takes kSpotFeatures features that were
/// measured along the pixels. rotation_rad is the angle from the pixels' x axis to the lenslets',
/// towards the features' y axis.
DenseLayer layer_for_sensor(const DenseLayer& taught, const SensorTraits& traits,
                            double rotation_rad);

/// Returns T, [kSpotModes, kSpotModes]: the modes along axes that are turned by angle_rad are
/// T·modes. Modes of one order turn among themselves.
std::array<std::array<double, kSpotModes>, kSpotModes> turned_modes(double angle_rad);

}  // namespace curlew
