#include "service/training/network_symmetry.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/as_size.h"
#include "service/training/training_lessons.h"

namespace curlew {
namespace {

constexpr std::size_t kSymmetries = 8;

/// Returns the place among `all` of the symmetry that does `first` to what `second` has done.
std::size_t composed(const std::vector<Symmetry>& all, const Symmetry& first,
                     const Symmetry& second) {
  std::array<int, kPatchLenslets> lenslet{};
  for (std::size_t i = 0; i < lenslet.size(); ++i)
    lenslet[i] = second.lenslet[as_size(first.lenslet[i])];
  const auto same = [&](const Symmetry& s) { return s.lenslet == lenslet; };
  return static_cast<std::size_t>(std::find_if(all.begin(), all.end(), same) - all.begin());
}

}  // namespace

NetworkSymmetry::NetworkSymmetry(const JudgeLayers& judge) {
  const std::vector<Symmetry> all = all_symmetries();
  // (s·x)[i] = sign[i]·x[place[i]] for each symmetry s and each kind of numbers x.
  const auto moves_of = [&](std::size_t n, auto move) {
    std::vector<Move> moves;
    for (std::size_t s = 0; s < all.size(); ++s) {
      Move& of_symmetry = moves.emplace_back();
      for (std::size_t i = 0; i < n; ++i) {
        const auto [place, sign] = move(s, i);
        of_symmetry.place.push_back(place);
        of_symmetry.sign.push_back(sign);
      }
    }
    return moves;
  };
  struct Moved {
    std::size_t place;
    float sign;
  };
  const auto taught_inputs = moves_of(kTaughtInputs, [&](std::size_t s, std::size_t i) -> Moved {
    if (i + 1 == kTaughtInputs) return {i, 1.0F};
    const std::size_t feature = i % kSpotFeatures;
    return {i - feature + as_size(all[s].feature[feature]), all[s].sign[feature]};
  });
  std::vector<std::size_t> product(kSymmetries * kSymmetries);
  for (std::size_t s = 0; s < all.size(); ++s)
    for (std::size_t g = 0; g < all.size(); ++g)
      product[s * kSymmetries + g] = composed(all, all[g], all[s]);
  const auto place_of_hidden = [&](std::size_t s, std::size_t i) {
    const std::size_t g = i % kSymmetries;
    return i - g + product[s * kSymmetries + g];
  };
  const auto hidden = [&](int n) {
    return moves_of(as_size(n), [&](std::size_t s, std::size_t i) -> Moved {
      return {place_of_hidden(s, i), 1.0F};
    });
  };
  const std::size_t code = as_size(judge.code);
  const auto patch = moves_of(kPatchLenslets * code, [&](std::size_t s, std::size_t i) -> Moved {
    return {as_size(all[s].lenslet[i / code]) * code + place_of_hidden(s, i % code), 1.0F};
  });
  const auto answers =
      moves_of(kFirstPairOutput + kPairOutputs, [&](std::size_t s, std::size_t i) -> Moved {
        const Symmetry& symmetry = all[s];
        const bool of_pair = i >= kFirstPairOutput;
        const std::size_t number = of_pair ? i - kFirstPairOutput : i % kNodeOutputs;
        const std::size_t first = i - number;
        const std::size_t from =
            symmetry.mirrors() && !of_pair ? as_size(kNodeOutputs) - first : first;
        if (number == 0 || (of_pair && number == 3)) return {from + number, 1.0F};
        if (number < 3) {
          const auto sign = static_cast<float>(number == 1 ? symmetry.sx : symmetry.sy);
          return {from + (symmetry.transpose ? 3 - number : number), sign};
        }
        if (symmetry.transpose) return {from + number, 0.0F};
        return {from + number, number == 4 ? static_cast<float>(symmetry.sx * symmetry.sy) : 1.0F};
      });
  for (int i = judge.encoder; i < judge.end; ++i) {
    const auto outputs_of = [](int layer) {
      return ClassifierNetwork::kOutputs[static_cast<std::size_t>(layer)];
    };
    layers_.push_back({i == judge.encoder ? taught_inputs
                       : i == judge.head  ? patch
                                          : hidden(outputs_of(i - 1)),
                       i + 1 == judge.end ? answers : hidden(outputs_of(i))});
  }
}

void NetworkSymmetry::symmetrise(std::size_t layer, AlignedVector<float>& weights,
                                 AlignedVector<float>& bias) const {
  const LayerMoves& moves = layers_[layer];
  const std::size_t outputs = bias.size();
  const std::size_t inputs = weights.size() / outputs;
  // In double, so that numbers that cancel leave nothing: Adam would make steps of what is left.
  std::vector<double> sums(weights.size(), 0.0);
  std::vector<double> bias_sums(outputs, 0.0);
  std::vector<double> counts(outputs, 0.0);
  for (std::size_t s = 0; s < kSymmetries; ++s) {
    const Move& in = moves.inputs[s];
    const Move& out = moves.outputs[s];
    for (std::size_t o = 0; o < outputs; ++o) {
      counts[out.place[o]] += static_cast<double>(std::abs(out.sign[o]));
      bias_sums[out.place[o]] += static_cast<double>(out.sign[o] * bias[o]);
    }
    for (std::size_t i = 0; i < inputs; ++i) {
      double* const to = &sums[in.place[i] * outputs];
      for (std::size_t o = 0; o < outputs; ++o)
        to[out.place[o]] +=
            static_cast<double>(in.sign[i] * out.sign[o] * weights[i * outputs + o]);
    }
  }
  for (std::size_t k = 0; k < weights.size(); ++k)
    weights[k] = static_cast<float>(sums[k] / counts[k % outputs]);
  for (std::size_t o = 0; o < outputs; ++o) bias[o] = static_cast<float>(bias_sums[o] / counts[o]);
}

}  // namespace curlew
