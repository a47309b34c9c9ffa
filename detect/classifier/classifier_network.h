// The network of the vortex classifier: an encoder of spots, then a judge of 4×4 of them.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "core/image.h"
#include "detect/classifier/scout_features.h"
#include "detect/classifier/spot_features.h"

namespace curlew {

inline constexpr int kPatch = 4;  ///< lenslets along a side of what is judged at once
inline constexpr int kPatchLenslets = kPatch * kPatch;
inline constexpr int kScreenPatch = 2;  ///< likewise of what is screened

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

/// What the network says of a node and an opposite pair that no sensor could tell apart.
struct PairOutput {
  float logit;  ///< of the probability that the middle of such a pair lies within .75 pitches
  float dx;     ///< where the middle is, from the node, pitches
  float dy;
  float log_scale;  ///< the middle's standard deviation along an axis is exp(−log_scale)
};
inline constexpr int kPairOutputs = sizeof(PairOutput) / sizeof(float);
inline constexpr int kFirstPairOutput = 2 * kNodeOutputs;  ///< after both signs
/// log_a, log_c and log_scale are clamped to these.
inline constexpr float kMinLogScale = -1.0F;
inline constexpr float kMaxLogScale = 4.0F;

/// Layers of the encoder, kSpotFeatures to kCode numbers; of the head, kPatchLenslets·kCode to two
/// NodeOutput (charge +1, then −1) and a PairOutput; of the scout, which says from centroids and
/// circulation alone whether a node deserves the others: kScoutFeatures to a logit and padding; of
/// the screen, which says so from the codes of the inner kScreenPatch² lenslets alone, likewise.
struct ClassifierNetwork {
  static constexpr int kEncoderEnd = 2;
  static constexpr int kHeadEnd = 5;
  static constexpr int kScoutEnd = 7;
  static constexpr int kLayers = 9;
  static constexpr std::array<int, kLayers> kOutputs{32, 16, 64, 32, 16, 8, 8, 16, 8};
  static constexpr int kCode = kOutputs[kEncoderEnd - 1];
  static constexpr int kWidest = kPatchLenslets * kCode;

  /// Whether a layer's outputs are made positive: all but those that are answers.
  static constexpr bool rectified(int layer) {
    return layer + 1 != kHeadEnd && layer + 1 != kScoutEnd && layer + 1 != kLayers;
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
