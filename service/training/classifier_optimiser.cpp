#include "service/training/classifier_optimiser.h"

#include <algorithm>
#include <cmath>

#include "detect/classifier/matrix_product.h"

namespace curlew {
namespace {

constexpr float kFirstDecay = 0.9F;
constexpr float kSecondDecay = 0.999F;
constexpr float kWeightDecay = 1e-3F;

}  // namespace

ClassifierOptimiser::ClassifierOptimiser(ClassifierNetwork& network, int first, int last, int batch)
    : layers_(network.layers.data() + first, network.layers.data() + last),
      first_(first),
      batch_(batch) {
  std::size_t maximum = 0;
  activations_.emplace_back(static_cast<std::size_t>(samples_of(0)) *
                            static_cast<std::size_t>(layers_.front().inputs));
  for (std::size_t i = 0; i < layers_.size(); ++i) {
    const DenseLayer& layer = layers_[i];
    activations_.emplace_back(static_cast<std::size_t>(samples_of(i)) *
                              static_cast<std::size_t>(layer.outputs));
    maximum = std::max(maximum, activations_.back().size());
    const auto zeros = [](const AlignedVector<float>& like) {
      const AlignedVector<float> zero(like.size());
      return Moments{zero, zero, zero};
    };
    moments_.push_back({zeros(layer.weights), zeros(layer.bias)});
    transposed_.resize(std::max(transposed_.size(), layer.weights.size()));
  }
  gradient_.resize(maximum);
  gradient_before_.resize(maximum);
}

int ClassifierOptimiser::samples_of(std::size_t layer) const {
  const int i = first_ + static_cast<int>(layer);
  const auto encodes = [i](const JudgeLayers& judge) {
    return i >= judge.encoder && i < judge.head;
  };
  return encodes(ClassifierNetwork::kJudge) || encodes(ClassifierNetwork::kReviewer)
             ? batch_ * kPatchLenslets
             : batch_;
}

const float* ClassifierOptimiser::run() {
  for (std::size_t i = 0; i < layers_.size(); ++i) {
    const DenseLayer& layer = layers_[i];
    multiply({activations_[i].data(), layer.inputs, 1}, layer.weights.data(), layer.bias.data(),
             samples_of(i), layer.inputs, layer.outputs,
             ClassifierNetwork::rectified(first_ + static_cast<int>(i)),
             activations_[i + 1].data());
  }
  return activations_.back().data();
}

void ClassifierOptimiser::step(double learning_rate, const NetworkSymmetry* symmetry) {
  for (std::size_t u = layers_.size(); u-- > 0;) {
    const DenseLayer& layer = layers_[u];
    const int samples = samples_of(u);
    const AlignedVector<float>& output = activations_[u + 1];
    if (ClassifierNetwork::rectified(first_ + static_cast<int>(u))) {
      for (std::size_t k = 0; k < output.size(); ++k)
        gradient_[k] = output[k] > 0.0F ? gradient_[k] : 0.0F;
    }
    multiply({activations_[u].data(), 1, layer.inputs}, gradient_.data(), nullptr, layer.inputs,
             samples, layer.outputs, false, moments_[u].weights.gradient.data());
    AlignedVector<float>& bias = moments_[u].bias.gradient;
    std::fill(bias.begin(), bias.end(), 0.0F);
    for (std::size_t k = 0; k < output.size(); k += bias.size())
      for (std::size_t o = 0; o < bias.size(); ++o) bias[o] += gradient_[k + o];
    if (symmetry != nullptr) symmetry->symmetrise(u, moments_[u].weights.gradient, bias);
    if (u == 0) break;
    const auto inputs = static_cast<std::size_t>(layer.inputs);
    const auto outputs = static_cast<std::size_t>(layer.outputs);
    for (std::size_t row = 0; row < inputs; ++row)
      for (std::size_t col = 0; col < outputs; ++col)
        transposed_[col * inputs + row] = layer.weights[row * outputs + col];
    multiply({gradient_.data(), layer.outputs, 1}, transposed_.data(), nullptr, samples,
             layer.outputs, layer.inputs, false, gradient_before_.data());
    gradient_.swap(gradient_before_);
  }
  ++steps_;
  const auto first_scale = static_cast<float>(1.0 / (1.0 - std::pow(kFirstDecay, steps_)));
  const auto second_scale = static_cast<float>(1.0 / (1.0 - std::pow(kSecondDecay, steps_)));
  const auto rate = static_cast<float>(learning_rate);
  const auto update = [&](AlignedVector<float>& values, Moments& m, float decay) {
    for (std::size_t k = 0; k < values.size(); ++k) {
      const float g = m.gradient[k];
      m.first[k] = kFirstDecay * m.first[k] + (1.0F - kFirstDecay) * g;
      m.second[k] = kSecondDecay * m.second[k] + (1.0F - kSecondDecay) * g * g;
      const float direction =
          first_scale * m.first[k] / (std::sqrt(second_scale * m.second[k]) + 1e-8F);
      values[k] -= rate * (direction + decay * values[k]);
    }
  };
  for (std::size_t i = 0; i < moments_.size(); ++i) {
    update(layers_[i].weights, moments_[i].weights, kWeightDecay);
    update(layers_[i].bias, moments_[i].bias, 0.0F);
  }
}

}  // namespace curlew
