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
};

}  // namespace

DenseLayer::DenseLayer(int n_inputs, int n_outputs)
    : inputs(n_inputs),
      outputs(n_outputs),
      weights(static_cast<std::size_t>(n_inputs) * static_cast<std::size_t>(n_outputs)),
      bias(static_cast<std::size_t>(n_outputs)) {}

ClassifierNetwork::ClassifierNetwork() {
  for (int i = 0; i < kLayers; ++i) {
    const int inputs = i == 0             ? kTaughtInputs
                       : i == kEncoderEnd ? kWidest
                       : i == kHeadEnd    ? kScoutFeatures
                       : i == kScoutEnd   ? kScreenPatch * kScreenPatch * kCode
                                          : layers.back().outputs;
    layers.emplace_back(inputs, kOutputs[static_cast<std::size_t>(i)]);
  }
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

ClassifierNetwork shipped_classifier_network() { return ClassifierNetwork(kShippedNumbers); }

}  // namespace curlew
