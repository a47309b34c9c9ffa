// What a simulated field teaches the vortex classifier: the labels of its nodes.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "core/image.h"
#include "service/bench/detection_dataset.h"
#include "service/bench/detection_score.h"

namespace curlew {

/// What should be said of a node and one kind of vortex.
struct Label {
  float present = 0;  ///< 1: there is one within kHitRadius
  float weight = 1;   ///< 0: unsure, for a vortex is near, but not near or certain enough
  float dx = 0;
  float dy = 0;
};
/// The labels for required vortices of charge +1, those of charge −1, and middles of unresolved
/// pairs.
using NodeLabel = std::array<Label, 3>;

/// Two opposite vortices that grade_vortices removes as a pair.
struct UnresolvedPair {
  double x = 0.0;  ///< of the middle, lenslet units
  double y = 0.0;
  double separation = 0.0;
  bool clear = true;  ///< at least kFaintestPair apart, and no required vortex within kHitRadius
};
/// Pairs closer than this, in pitches, leave hardly a trace.
inline constexpr double kFaintestPair = 0.3;
/// Returns the unresolved pairs of a graded field, the closest first.
std::vector<UnresolvedPair> unresolved_pairs(const std::vector<GradedVortex>& graded);

struct TrainingField {
  FieldParameters parameters;
  Image<float> light;
  Image<NodeLabel> labels;
  Image<std::uint8_t> near_vortex;
};

/// Windows wider than this, of ±1.5 λ/w, can make sensors of coarse pixels.
inline constexpr int kNarrowWindow_px = 12;

/// Returns the parameters of training realisation `index`, of ten Rytov variances and geometries,
/// which come round every 100. Pixels are .25 λ/w, of which sensors of coarser ones are made, and
/// three windows in ten are ±3 λ/w wide.
FieldParameters training_field(int index);

/// Returns the labels of the field's nodes, [rows − 1, cols − 1].
Image<NodeLabel> label_nodes(const FieldParameters& p, const std::vector<GradedVortex>& truth);

/// Labels the nodes of a realisation, and marks those with any vortex within 2 pitches on each
/// axis.
TrainingField make_training_field(const FieldParameters& p, Realisation realisation);

}  // namespace curlew
