// The network's gradient, and the step against it (Adam).
#pragma once

#include <span>
#include <vector>

#include "detect/classifier/classifier_network.h"
#include "service/training/network_symmetry.h"

namespace curlew {

/// Optimises by D. P. Kingma and J. Ba, "Adam", ICLR 2015, with decoupled weight decay (I.
/// Loshchilov and F. Hutter, ICLR 2019).
class ClassifierOptimiser {
 public:
  /// Optimises the layers [first, last) of the network, on `batch` samples of the last of them.
  ClassifierOptimiser(ClassifierNetwork& network, int first, int last, int batch);

  float* inputs() { return activations_.front().data(); }  ///< [samples, inputs of the first layer]
  /// Runs the layers on inputs(). Returns [batch, outputs of the last layer].
  const float* run();
  float* output_gradient() { return gradient_.data(); }  ///< of run()'s result; the caller fills it
  /// Makes a step by output_gradient(), which is overwritten. With a symmetry, by the gradient's
  /// part that has it.
  void step(double learning_rate, const NetworkSymmetry* symmetry = nullptr);

 private:
  struct Moments {
    AlignedVector<float> gradient, first, second;
  };
  struct LayerMoments {
    Moments weights, bias;
  };
  int samples_of(std::size_t layer) const;

  std::span<DenseLayer> layers_;
  int first_;
  int batch_;
  int steps_ = 0;
  // The inputs, and then the outputs of every layer.
  std::vector<AlignedVector<float>> activations_;
  AlignedVector<float> gradient_;
  AlignedVector<float> gradient_before_;
  AlignedVector<float> transposed_;
  std::vector<LayerMoments> moments_;
};

}  // namespace curlew
