// The network's gradient, and the step against it (Adam).
#pragma once

#include <span>
#include <vector>

#include "detect/classifier/classifier_network.h"

namespace curlew {

/// D. P. Kingma and J. Ba, "Adam", ICLR 2015, with decoupled weight decay (I. Loshchilov and
/// F. Hutter, ICLR 2019).
class ClassifierOptimiser {
 public:
  /// Layers [first, last) of the network, on `batch` samples of the last of them.
  ClassifierOptimiser(ClassifierNetwork& network, int first, int last, int batch);

  float* inputs() { return activations_.front().data(); }  ///< [samples, the first's inputs]
  /// Runs the layers on inputs(): [batch, the last's outputs].
  const float* run();
  float* output_gradient() { return gradient_.data(); }  ///< of run()'s result, to be filled
  /// From output_gradient(), which is overwritten.
  void step(double learning_rate);

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
  std::vector<AlignedVector<float>> activations_;  // inputs, then what every layer makes of them
  AlignedVector<float> gradient_;
  AlignedVector<float> gradient_before_;
  AlignedVector<float> transposed_;
  std::vector<LayerMoments> moments_;
};

}  // namespace curlew
