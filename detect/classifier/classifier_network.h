// This file declares the network of the vortex classifier: an encoder of spots, and a head that
// judges 4×4 of them.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "core/image.h"
#include "detect/classifier/scout_features.h"
#include "detect/classifier/spot_features.h"

namespace curlew {

inline constexpr int kPatch = 4;  ///< lenslets along a side of the patch that is judged
inline constexpr int kPatchLenslets = kPatch * kPatch;
/// The encoder is taught kTraitBlocks copies of a spot's features, each times something of the
/// sensor, and one number more; sensor_encoder.h tells what they are.
inline constexpr int kTraitBlocks = 4;
inline constexpr int kTaughtInputs = kTraitBlocks * kSpotFeatures + 1;
inline constexpr int kScreenPatch = 2;  ///< lenslets along a side of the patch that is screened

/// Holds one layer: outputs = inputs·weights + bias. See ClassifierNetwork::rectified() for
/// negative outputs.
struct DenseLayer {
  DenseLayer(int n_inputs, int n_outputs);

  int inputs;
  int outputs;                   ///< a multiple of kProductColumns
  AlignedVector<float> weights;  ///< [inputs, outputs]
  AlignedVector<float> bias;     ///< [outputs]
};

/// This is what the network says of a node and one sign of charge.
struct NodeOutput {
  float logit;  ///< logit of the probability that such a vortex lies within .75 pitches
  float dx;     ///< position of the vortex from the node, pitches
  float dy;
  /// The position's inverse covariance is MᵀM, M = [[exp(log_a), 0], [b, exp(log_c)]].
  float log_a;
  float b;
  float log_c;
};
inline constexpr int kNodeOutputs = sizeof(NodeOutput) / sizeof(float);

/// This is what the network says of a node and an opposite pair that no sensor could tell apart.
struct PairOutput {
  float logit;  ///< logit of the probability that such a pair's middle lies within .75 pitches
  float dx;     ///< position of the middle from the node, pitches
  float dy;
  float log_scale;  ///< the middle's standard deviation along an axis is exp(−log_scale)
};
inline constexpr int kPairOutputs = sizeof(PairOutput) / sizeof(float);
inline constexpr int kFirstPairOutput = 2 * kNodeOutputs;  ///< the PairOutput follows both signs
/// log_a, log_c and log_scale are clamped to the range between these two.
inline constexpr float kMinLogScale = -1.0F;
inline constexpr float kMaxLogScale = 4.0F;

/// Holds the layers of four parts:
/// - The encoder turns kTaughtInputs numbers into kCode.
/// - The head turns kPatchLenslets·kCode numbers into two NodeOutput (charge +1, then −1) and a
///   PairOutput.
/// - The scout says from centroids and circulation alone whether a node deserves the others. It
///   turns kScoutFeatures numbers into a logit and padding.
/// - The screen says the same from the codes of the inner kScreenPatch² lenslets alone. It turns
///   these into a logit and padding.
struct ClassifierNetwork {
  static constexpr int kEncoderEnd = 2;
  static constexpr int kHeadEnd = 5;
  static constexpr int kScoutEnd = 7;
  static constexpr int kLayers = 9;
  static constexpr std::array<int, kLayers> kOutputs{32, 16, 64, 32, 16, 8, 8, 16, 8};
  static constexpr int kCode = kOutputs[kEncoderEnd - 1];
  static constexpr int kWidest = kPatchLenslets * kCode;

  /// Returns whether negative outputs of a layer become 0. Those of all layers do, but for the
  /// layers that give the answers.
  static constexpr bool rectified(int layer) {
    return layer + 1 != kHeadEnd && layer + 1 != kScoutEnd && layer + 1 != kLayers;
  }

  ClassifierNetwork();
  /// Takes the numbers of all layers in order, weights before biases. Throws Failure if their count
  /// is not number_count().
  explicit ClassifierNetwork(std::span<const float> numbers);
  static std::size_t number_count();

  std::vector<DenseLayer> layers;
};

/// Returns the network that comes with the program. The file of its weights says how it was
/// trained.
ClassifierNetwork shipped_classifier_network();

}  // namespace curlew
