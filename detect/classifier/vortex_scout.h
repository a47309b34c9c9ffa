// Which nodes deserve a closer look: what centroids and circulation alone say of every node.
#pragma once

#include "core/centroids.h"
#include "core/image.h"
#include "core/vortex.h"
#include "detect/classifier/classifier_network.h"

namespace curlew {

/// Whether the classifier can make nothing of such a lenslet. Faint spots and those at the window's
/// edge are not missing, their pixels count.
inline bool is_missing(LensletState state) noexcept {
  return (state == LensletState::kUnlit) | (state == LensletState::kSaturated) |
         (state == LensletState::kBadPixels);
}

/// Buffers of one frame, made once. Rows are padded, those of nodes to
/// `stride` columns.
struct ScoutWorkspace {
  ScoutWorkspace(int rows, int cols);  // of lenslets

  Image<float> brightness;  ///< [rows, ≥ cols]: flux r over the mean as r/(r + .2); missing: r = 1
  Image<float> spread;      ///< [rows, ≥ cols]: second moments, (λ/w)²; missing: 0
  Image<float> circulation;   ///< [rows + 1, ≥ cols + 1]: D with a rim of zeros, within ±4 rad
  Image<float> noise;         ///< [rows − 1, ≥ cols]: the variance v of D, rad², as v/(v + 1)
  Image<float> features;      ///< [kScoutFeatures, stride] of a row of nodes
  Image<float> hidden;        ///< [the scout's hidden layer, stride], likewise
  Image<float> logits;        ///< [rows − 1, stride]
  AlignedVector<float> bias;  ///< [stride], of the logits
};

/// Of the lenslets not missing, ADU; 0 without any.
float mean_flux(const Centroids& centroids) noexcept;

/// Fills the maps.
void describe_lenslets(const Centroids& centroids, const CirculationMap& circulation,
                       float mean_flux_adu, float pixels_per_lambda_w,
                       ScoutWorkspace& workspace) noexcept;

/// Fills `features` of a row of nodes, after describe_lenslets.
void describe_nodes(int row, ScoutWorkspace& workspace) noexcept;

/// Fills `logits`, after describe_lenslets. The network's first scouting layer must have no bias:
/// its first input is 1.
void scout_nodes(const ClassifierNetwork& network, ScoutWorkspace& workspace) noexcept;

}  // namespace curlew
