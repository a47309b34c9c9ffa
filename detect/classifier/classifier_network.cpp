#include "detect/classifier/classifier_network.h"

#include <algorithm>
#include <string>
#include <utility>

#include "core/error.h"
#include "detect/classifier/matrix_product.h"

namespace curlew {
namespace {

constexpr float kShippedNumbers[] = {
#include "detect/classifier/vortex_classifier_weights.inc"
#include "detect/classifier/vortex_reviewer_weights.inc"
};

constexpr int inputs_of(int layer) {
  using Network = ClassifierNetwork;
  switch (layer) {
    case Network::kJudge.encoder:
    case Network::kReviewer.encoder:
      return kTaughtInputs;
    case Network::kJudge.head:
      return kPatchLenslets * Network::kJudge.code;
    case Network::kReviewer.head:
      return kPatchLenslets * Network::kReviewer.code;
    case Network::kScout:
      return kScoutFeatures;
    case Network::kScreen:
      return kScreenPatch * kScreenPatch * Network::kJudge.code;
    default:
      return Network::kOutputs[static_cast<std::size_t>(layer) - 1];
  }
}

}  // namespace

DenseLayer::DenseLayer(int n_inputs, int n_outputs)
    : inputs(n_inputs),
      outputs(n_outputs),
      weights(static_cast<std::size_t>(n_inputs) * static_cast<std::size_t>(n_outputs)),
      bias(static_cast<std::size_t>(n_outputs)) {}

ClassifierNetwork::ClassifierNetwork() {
  for (int i = 0; i < kLayers; ++i)
    layers.emplace_back(inputs_of(i), kOutputs[static_cast<std::size_t>(i)]);
}

std::size_t ClassifierNetwork::number_count() {
  std::size_t count = 0;
  for (const DenseLayer& layer : ClassifierNetwork().layers)
    count += layer.weights.size() + layer.bias.size();
  return count;
}

ClassifierNetwork::ClassifierNetwork(std::span<const float> numbers) : ClassifierNetwork() {
  if (numbers.size() != number_count()) {
    throw Failure("a vortex classifier has " + std::to_string(number_count()) +
                  " numbers, but the weights are " + std::to_string(numbers.size()) +
                  "; train it anew with 'curlew bench train'");
  }
  for (DenseLayer& layer : layers) {
    for (AlignedVector<float>* part : {&layer.weights, &layer.bias}) {
      std::copy_n(numbers.begin(), part->size(), part->begin());
      numbers = numbers.subspan(part->size());
    }
  }
}

const float* apply_layers(const ClassifierNetwork& network, int first, int last, int n, float* in,
                          float* out) noexcept {
  for (int i = first; i < last; ++i) {
    const DenseLayer& layer = network.layers[static_cast<std::size_t>(i)];
    multiply({in, layer.inputs, 1}, layer.weights.data(), layer.bias.data(), n, layer.inputs,
             layer.outputs, ClassifierNetwork::rectified(i), out);
    std::swap(in, out);
  }
  return in;
}

ClassifierNetwork shipped_classifier_network() { return ClassifierNetwork(kShippedNumbers); }

}  // namespace curlew
