// This file declares the network of the vortex classifier: encoders of spots, and heads that judge
// 4×4 of them.
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

/// Says which layers are an encoder, which turns kTaughtInputs numbers into the code of a spot, and
/// the head that goes with it, which turns the codes of kPatchLenslets spots into two NodeOutput
/// (charge +1, then −1) and a PairOutput.
struct JudgeLayers {
  int encoder;  ///< the first layer of the encoder
  int head;     ///< the first layer of the head
  int end;      ///< the first layer after the head
  int code;     ///< numbers in a code
};

/// Holds the layers of four parts:
/// - The judge is an encoder and a head.
/// - The scout says from centroids and circulation alone whether a node deserves the others. It
///   turns kScoutFeatures numbers into a logit and padding.
/// - The screen says the same from the judge's codes of the inner kScreenPatch² lenslets alone. It
///   turns these into a logit and padding.
/// - The reviewer is a second, larger judge, for nodes at which the first sees something.
struct ClassifierNetwork {
  static constexpr int kLayers = 14;
  static constexpr std::array<int, kLayers> kOutputs{32, 16, 64, 32, 16, 8,  8,
                                                     16, 8,  48, 24, 96, 48, 16};
  static constexpr JudgeLayers kJudge{0, 2, 5, kOutputs[1]};
  static constexpr int kScout = kJudge.end;   ///< the first layer of the scout
  static constexpr int kScreen = kScout + 2;  ///< the first layer of the screen
  static constexpr JudgeLayers kReviewer{9, 11, kLayers, kOutputs[10]};
  static_assert(kScreen + 2 == kReviewer.encoder);
  static constexpr int kMostInputs = kPatchLenslets * kReviewer.code;  ///< of all layers

  /// Returns whether negative outputs of a layer become 0. Those of all layers do, but for the
  /// layers that give the answers.
  static constexpr bool rectified(int layer) {
    const int next = layer + 1;
    return next != kJudge.end && next != kScreen && next != kReviewer.encoder &&
           next != kReviewer.end;
  }

  ClassifierNetwork();
  /// Takes the numbers of all layers in order, weights before biases. Throws Failure if their count
  /// is not number_count().
  explicit ClassifierNetwork(std::span<const float> numbers);
  static std::size_t number_count();

  std::vector<DenseLayer> layers;
};

/// Applies layers [first, last) to n samples in `in`. Returns the buffer that holds the result.
/// Both buffers are used, and each must have room for n times the most inputs or outputs of these
/// layers.
const float* apply_layers(const ClassifierNetwork& network, int first, int last, int n, float* in,
                          float* out) noexcept;

/// Returns the network that comes with the program. The two files of its weights say how it was
/// trained.
ClassifierNetwork shipped_classifier_network();

}  // namespace curlew
