// This file declares the scout. From centroids and circulation alone it says for every node whether
// it deserves a closer look.
#pragma once

#include "core/centroids.h"
#include "core/image.h"
#include "core/vortex.h"
#include "detect/classifier/classifier_network.h"

namespace curlew {

/// Returns whether a lenslet is of no use for the classifier. Faint spots and those at the window's
/// edge are not missing, because their pixels count.
inline bool is_missing(LensletState state) noexcept {
  return (state == LensletState::kUnlit) | (state == LensletState::kSaturated) |
         (state == LensletState::kBadPixels) | (state == LensletState::kLost);
}

/// These are the buffers of one frame, made once. Rows are padded, and those of nodes to `stride`
/// columns.
struct ScoutWorkspace {
  ScoutWorkspace(int rows, int cols);  // in lenslets

  Image<float> brightness;  ///< [rows, ≥ cols] r/(r + .2) of flux over mean r; missing: r = 1
  Image<float> spread;  ///< [rows, ≥ cols] second moments less the sensor's excess_spread, (λ/w)²;
                        ///< 0 where missing
  Image<float> circulation;   ///< [rows + 1, ≥ cols + 1] D within ±4 rad, with a rim of zeros
  Image<float> noise;         ///< [rows − 1, ≥ cols] v/(v + 1) of the variance v of D, rad²
  Image<float> features;      ///< [kScoutFeatures, stride] for one row of nodes
  Image<float> hidden;        ///< [the scout's hidden layer, stride] for one row of nodes
  Image<float> logits;        ///< [rows − 1, stride]
  AlignedVector<float> bias;  ///< [stride] for the logits
};

/// Returns the mean flux of the lenslets that are not missing, in ADU, and 0 where there are none.
float mean_flux(const Centroids& centroids) noexcept;

/// Fills the maps of brightness, spread, circulation and noise.
void describe_lenslets(const Centroids& centroids, const CirculationMap& circulation,
                       float mean_flux_adu, float pixels_per_lambda_w, float excess_spread,
                       ScoutWorkspace& workspace) noexcept;

/// Fills `features` of a row of nodes; describe_lenslets() must come first.
void describe_nodes(int row, ScoutWorkspace& workspace) noexcept;

/// Fills `logits`; describe_lenslets() must come first. The network's first scouting layer must
/// have no bias; its first input is 1 instead.
void scout_nodes(const ClassifierNetwork& network, ScoutWorkspace& workspace) noexcept;

}  // namespace curlew
