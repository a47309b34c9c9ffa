#include "detect/classifier/vortex_scout.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "detect/classifier/matrix_product.h"

namespace curlew {
namespace {

constexpr float kHalfBright = 0.2F;      // of the mean flux; its brightness is ½
constexpr float kWidestSpread = 2.0F;    // (λ/w)²; all that is wider counts the same
constexpr float kMaxCirculation = 4.0F;  // rad; all that is more counts the same

int padded(int nodes) { return (nodes + kScoutLanes - 1) / kScoutLanes * kScoutLanes; }

}  // namespace

ScoutWorkspace::ScoutWorkspace(int rows, int cols)
    : brightness(rows, padded(cols) + kScoutLanes),
      spread(brightness.rows(), brightness.cols()),
      circulation(rows + 1, brightness.cols()),
      noise(rows - 1, brightness.cols()),
      features(kScoutFeatures, padded(cols - 1)),
      hidden(ClassifierNetwork::kOutputs[ClassifierNetwork::kScout], features.cols()),
      logits(rows - 1, features.cols()),
      bias(static_cast<std::size_t>(features.cols())) {}

float mean_flux(const Centroids& centroids) noexcept {
  constexpr std::size_t kLanes = 8;  // Lanes let the compiler make vectors.
  std::array<float, kLanes> sums{};
  std::array<float, kLanes> counts{};
  const std::size_t n = centroids.state.size();
  const auto add = [&](std::size_t k, std::size_t lane) {
    const float counted = is_missing(centroids.state[k]) ? 0.0F : 1.0F;
    sums[lane] += counted * centroids.flux_adu[k];
    counts[lane] += counted;
  };
  std::size_t k = 0;
  for (; k + kLanes <= n; k += kLanes)
    for (std::size_t lane = 0; lane < kLanes; ++lane) add(k + lane, lane);
  for (; k < n; ++k) add(k, 0);
  float sum = 0.0F;
  float count = 0.0F;
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    sum += sums[lane];
    count += counts[lane];
  }
  return count > 0.0F ? sum / count : 0.0F;
}

void describe_lenslets(const Centroids& centroids, const CirculationMap& circulation,
                       float mean_flux_adu, float pixels_per_lambda_w, float excess_spread,
                       ScoutWorkspace& workspace) noexcept {
  const float per_flux = 1.0F / std::max(mean_flux_adu, 1e-30F);
  const float per_square = 1.0F / (pixels_per_lambda_w * pixels_per_lambda_w);
  const auto cols = static_cast<std::size_t>(centroids.state.cols());
  for (int row = 0; row < centroids.state.rows(); ++row) {
    const LensletState* state = &centroids.state(row, 0);
    const float* flux = &centroids.flux_adu(row, 0);
    const float* xx = &centroids.xx_px2(row, 0);
    const float* yy = &centroids.yy_px2(row, 0);
    float* __restrict brightness = &workspace.brightness(row, 0);
    float* __restrict spread = &workspace.spread(row, 0);
    for (std::size_t c = 0; c < cols; ++c) {
      const float ratio = std::max(flux[c] * per_flux, 0.0F);
      brightness[c] = ratio / (ratio + kHalfBright);
      spread[c] = std::min((xx[c] + yy[c]) * per_square - excess_spread, kWidestSpread);
    }
    bool complete = true;
    for (std::size_t c = 0; c < cols; ++c) complete &= !is_missing(state[c]);
    for (std::size_t c = 0; !complete && c < cols; ++c) {
      if (!is_missing(state[c])) continue;
      brightness[c] = 1.0F / (1.0F + kHalfBright);
      spread[c] = 0.0F;
    }
  }
  for (int row = 0; row < circulation.value.rows(); ++row) {
    const float* d = &circulation.value(row, 0);
    const float* variance = &circulation.variance(row, 0);
    float* __restrict to = &workspace.circulation(row + 1, 1);
    float* __restrict noise = &workspace.noise(row, 0);
    for (std::size_t c = 0; c + 1 < cols; ++c) {
      to[c] = std::min(std::max(d[c], -kMaxCirculation), kMaxCirculation);
      noise[c] = variance[c] / (variance[c] + 1.0F);
    }
  }
}

void describe_nodes(int row, ScoutWorkspace& workspace) noexcept {
  scout_features({.circulation_above = &workspace.circulation(row, 0),
                  .circulation = &workspace.circulation(row + 1, 0),
                  .circulation_below = &workspace.circulation(row + 2, 0),
                  .brightness_above = &workspace.brightness(row, 0),
                  .brightness_below = &workspace.brightness(row + 1, 0),
                  .spread_above = &workspace.spread(row, 0),
                  .spread_below = &workspace.spread(row + 1, 0),
                  .noise = &workspace.noise(row, 0)},
                 workspace.features.cols(), workspace.features.data());
}

void scout_nodes(const ClassifierNetwork& network, ScoutWorkspace& workspace) noexcept {
  const DenseLayer& first = network.layers[ClassifierNetwork::kScout];
  const DenseLayer& second = network.layers[ClassifierNetwork::kScout + 1];
  const int stride = workspace.features.cols();
  std::fill(workspace.bias.begin(), workspace.bias.end(), second.bias[0]);
  for (int row = 0; row < workspace.logits.rows(); ++row) {
    describe_nodes(row, workspace);
    // The product is turned about: the nodes are its columns.
    multiply({first.weights.data(), 1, first.outputs}, workspace.features.data(), nullptr,
             first.outputs, first.inputs, stride, true, workspace.hidden.data());
    multiply({second.weights.data(), 1, second.outputs}, workspace.hidden.data(),
             workspace.bias.data(), 1, second.inputs, stride, false, &workspace.logits(row, 0));
  }
}

}  // namespace curlew
