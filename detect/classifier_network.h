// The network of the vortex classifier: an encoder of spots, then a judge of 4×4 of them.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "core/image.h"
#include "detect/spot_features.h"

namespace curlew {

inline constexpr int kPatch = 4;  ///< lenslets along a side of what is judged at once
inline constexpr int kPatchLenslets = kPatch * kPatch;

/// A layer: outputs = inputs·weights + bias, all but the network's last rectified.
struct DenseLayer {
  DenseLayer(int n_inputs, int n_outputs);

  int inputs;
  int outputs;                   ///< a multiple of kProductColumns
  AlignedVector<float> weights;  ///< [inputs, outputs]
  AlignedVector<float> bias;     ///< [outputs]
};

/// What the network says of a node and one sign of charge.
struct NodeOutput {
  float logit;  ///< of the probability that such a vortex lies within .75 pitches
  float dx;     ///< where it is, from the node, pitches
  float dy;
  /// The position's inverse covariance is MᵀM, M = [[exp(log_a), 0], [b, exp(log_c)]].
  float log_a;
  float b;
  float log_c;
};
inline constexpr int kNodeOutputs = sizeof(NodeOutput) / sizeof(float);
/// log_a and log_c are clamped to these.
inline constexpr float kLeastLogScale = -1.0F;
inline constexpr float kMostLogScale = 4.0F;

/// What the scout gets of a node; see describe_node in vortex_classifier.cpp.
inline constexpr int kScoutFeatures = 19;

/// Layers of the encoder, kSpotFeatures to kCode numbers; of the head, kPatchLenslets·kCode to two
/// NodeOutput (charge +1, then −1) and padding; of the scout, which says from centroids and
/// circulation alone whether a node deserves the others: kScoutFeatures to a logit and padding.
struct ClassifierNetwork {
  static constexpr int kEncoderEnd = 2;
  static constexpr int kHeadEnd = 5;
  static constexpr int kLayers = 7;
  static constexpr std::array<int, kLayers> kOutputs{32, 16, 64, 32, 16, 16, 16};
  static constexpr int kCode = kOutputs[kEncoderEnd - 1];
  static constexpr int kWidest = kPatchLenslets * kCode;

  /// Whether a layer's outputs are made positive: all but those that are answers.
  static constexpr bool rectified(int layer) {
    return layer + 1 != kHeadEnd && layer + 1 != kLayers;
  }

  ClassifierNetwork();
  /// From the numbers of all layers in order, weights before biases. Throws Failure on another
  /// count than number_count().
  explicit ClassifierNetwork(std::span<const float> numbers);
  static std::size_t number_count();

  std::vector<DenseLayer> layers;
};

/// The network that comes with the program; the file of its weights says how it was trained.
ClassifierNetwork shipped_classifier_network();

}  // namespace curlew
