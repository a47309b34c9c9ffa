#include "detect/classifier/patch_judge.h"

#include <algorithm>
#include <array>
#include <cstddef>

#include "core/as_size.h"
#include "detect/classifier/matrix_product.h"
#include "detect/classifier/vortex_scout.h"

namespace curlew {
namespace {

constexpr std::size_t kMostCode =
    as_size(std::max(ClassifierNetwork::kJudge.code, ClassifierNetwork::kReviewer.code));

using Chunk = std::array<std::int32_t, kJudgeChunk>;

/// Applies an encoder, whose first layer is that for the sensor, to the features of n spots.
/// Returns the buffer that holds the codes.
const float* encode(const ClassifierNetwork& network, const JudgeLayers& layers,
                    const DenseLayer& first, int n, const float* features,
                    LayerBuffers& buffers) noexcept {
  multiply({features, first.inputs, 1}, first.weights.data(), first.bias.data(), n, first.inputs,
           first.outputs, ClassifierNetwork::rectified(layers.encoder), buffers.b.data());
  return apply_layers(network, layers.encoder + 1, layers.head, n, buffers.b.data(),
                      buffers.a.data());
}

/// Encodes lenslets. features_of(chunk, n) returns the features of the first n lenslets of a chunk.
template <typename FeaturesOf>
void encode_all(const ClassifierNetwork& network, const PatchJudge& judge, const FrameSpots& spots,
                std::span<const std::int32_t> lenslets, FeaturesOf features_of,
                LayerBuffers& buffers, SpotCodes& codes) noexcept {
  const int cols = spots.features.cols();
  const std::ptrdiff_t code = judge.layers.code;
  Chunk chunk;
  std::array<std::ptrdiff_t, kJudgeChunk> to;
  std::array<std::int16_t, as_size(kJudgeChunk) * kMostCode> rounded;
  int n = 0;
  const auto encode_chunk = [&] {
    const float* const exact =
        encode(network, judge.layers, codes.coding->layer, n, features_of(chunk, n), buffers);
    round_codes(exact, n * judge.layers.code, rounded.data());
    for (int i = 0; i < n; ++i) {
      const std::ptrdiff_t at = to[as_size(i)];
      std::copy_n(rounded.data() + i * code, code, codes.rounded.data() + at);
      if (judge.as_trained) std::copy_n(exact + i * code, code, codes.exact.data() + at);
    }
    n = 0;
  };
  for (const std::int32_t k : lenslets) {
    const std::ptrdiff_t at = (std::ptrdiff_t{k / cols + 1} * (cols + 2) + k % cols + 1) * code;
    if (is_missing(spots.centroids.state[as_size(k)]) || !spots.features.has_lenslet(as_size(k))) {
      std::ranges::copy(judge.missing_rounded, codes.rounded.data() + at);
      if (judge.as_trained) std::ranges::copy(judge.missing_code, codes.exact.data() + at);
      continue;
    }
    to[as_size(n)] = at;
    chunk[as_size(n++)] = k;
    if (n == kJudgeChunk) encode_chunk();
  }
  if (n > 0) encode_chunk();
}

}  // namespace

MeasuredSpots::MeasuredSpots(std::size_t lenslets)
    : features(lenslets * kSpotFeatures + kProjectionSlack), places(lenslets) {}

LayerBuffers::LayerBuffers()
    : a(as_size(kJudgeChunk) * ClassifierNetwork::kMostInputs), b(a.size()) {}

PatchJudge::PatchJudge(const ClassifierNetwork& network, const JudgeLayers& of_network,
                       const SpotCamera& camera, bool like_training)
    : layers(of_network),
      as_trained(like_training),
      codings(network.layers[as_size(layers.encoder)], camera, as_trained),
      head(network.layers[as_size(layers.head)], kPatch) {
  LayerBuffers buffers;
  constexpr std::array<float, kSpotFeatures> kMissing{};
  const float* code =
      encode(network, layers, codings.as_calibrated().layer, 1, kMissing.data(), buffers);
  missing_code.assign(code, code + layers.code);
  missing_rounded.resize(missing_code.size());
  round_codes(code, layers.code, missing_rounded.data());
}

SpotCodes::SpotCodes(const PatchJudge& judge, int rows, int cols)
    : rounded(rows + 2, (cols + 2) * judge.layers.code) {
  if (judge.as_trained) exact = Image<float>(rounded.rows(), rounded.cols());
  for (std::size_t i = 0; i < rounded.size(); i += judge.missing_code.size()) {
    std::ranges::copy(judge.missing_rounded, rounded.data() + i);
    if (judge.as_trained) std::ranges::copy(judge.missing_code, exact.data() + i);
  }
}

void measure_and_encode(const ClassifierNetwork& network, const PatchJudge& judge,
                        const FrameSpots& spots, std::span<const std::int32_t> lenslets,
                        MeasuredSpots& measured, LayerBuffers& buffers, SpotCodes& codes) noexcept {
  const SpotFeatures& features = spots.features;
  const Image<float>& flux_adu = spots.centroids.flux_adu;
  const auto features_of = [&](const Chunk& chunk, int n) {
    float* const to = measured.features.data() + measured.count * kSpotFeatures;
    if (!judge.as_trained) {
      features.measure_many(spots.frame, spots.shift, chunk.data(), n, flux_adu.data(),
                            spots.mean_flux_adu, to);
    }
    for (std::size_t i = 0; i < as_size(n); ++i) {
      const std::size_t k = as_size(chunk[i]);
      if (judge.as_trained) {
        features.measure(spots.frame, spots.shift, k, flux_adu[k], spots.mean_flux_adu,
                         to + i * kSpotFeatures);
      }
      measured.places[k] = static_cast<std::int32_t>(measured.count + i);
    }
    measured.count += as_size(n);
    return to;
  };
  encode_all(network, judge, spots, lenslets, features_of, buffers, codes);
}

void encode_measured(const ClassifierNetwork& network, const PatchJudge& judge,
                     const FrameSpots& spots, std::span<const std::int32_t> lenslets,
                     const MeasuredSpots& measured, LayerBuffers& buffers,
                     SpotCodes& codes) noexcept {
  const auto features_of = [&](const Chunk& chunk, int n) {
    float* const to = buffers.a.data();
    for (std::size_t i = 0; i < as_size(n); ++i) {
      const std::size_t place = as_size(measured.places[as_size(chunk[i])]);
      std::copy_n(measured.features.data() + place * kSpotFeatures, kSpotFeatures,
                  to + i * kSpotFeatures);
    }
    return to;
  };
  encode_all(network, judge, spots, lenslets, features_of, buffers, codes);
}

void find_patches(std::span<const std::int32_t> nodes, int node_cols, int code, int row_step,
                  std::int32_t* starts) noexcept {
  for (const std::int32_t node : nodes)
    *starts++ = node / node_cols * row_step + node % node_cols * code;
}

const float* judge_patches(const ClassifierNetwork& network, const PatchJudge& judge,
                           const SpotCodes& codes, std::span<const std::int32_t> nodes,
                           int node_cols, LayerBuffers& buffers) noexcept {
  const JudgeLayers& layers = judge.layers;
  const int row_step = codes.rounded.cols();
  const int n = static_cast<int>(nodes.size());
  std::array<std::int32_t, kJudgeChunk> starts;
  find_patches(nodes, node_cols, layers.code, row_step, starts.data());
  if (!judge.as_trained) {
    multiply_patches(judge.head, codes.rounded.data(), row_step, starts.data(), n,
                     buffers.a.data());
    return apply_layers(network, layers.head + 1, layers.end, n, buffers.a.data(),
                        buffers.b.data());
  }
  const std::ptrdiff_t row_codes = std::ptrdiff_t{kPatch} * layers.code;
  float* to = buffers.a.data();
  for (int i = 0; i < n; ++i) {
    const float* from = codes.exact.data() + starts[as_size(i)];
    for (int row = 0; row < kPatch; ++row, from += row_step, to += row_codes)
      std::copy_n(from, row_codes, to);
  }
  return apply_layers(network, layers.head, layers.end, n, buffers.a.data(), buffers.b.data());
}

}  // namespace curlew
