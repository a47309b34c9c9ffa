#include "detect/classifier/patch_layer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "acquisition/simulator/random_stream.h"
#include "detect/classifier/classifier_network.h"

namespace curlew {
namespace {

constexpr std::uint64_t kSeed = 20260801;

class PatchLayerOf : public ::testing::TestWithParam<int> {};

/// The fixed-point layer agrees within what rounding may do: half a step of each code times the
/// weights, and half a step of each weight times the codes. It does so for every number of patches
/// up to more than a tile.
TEST_P(PatchLayerOf, AgreesWithItsLayer) {
  const ClassifierNetwork network = shipped_classifier_network();
  const DenseLayer& layer = network.layers[static_cast<std::size_t>(GetParam())];
  const int rows = GetParam() == ClassifierNetwork::kScreen ? kScreenPatch : kPatch;
  const int code_size = layer.inputs / (rows * rows);
  const PatchLayer patch_layer(layer, rows);
  constexpr int kPatches = 15;
  const std::ptrdiff_t row_step = std::ptrdiff_t{code_size} * (kPatches + kPatch);
  RandomStream random(kSeed, 0);
  std::vector<float> codes(static_cast<std::size_t>(row_step * kPatch));
  for (float& code : codes)
    code = static_cast<float>(std::max(0.0, random.uniform() < 0.01 ? 7.9 : random.gaussian()));
  std::vector<std::int16_t> rounded(codes.size());
  round_codes(codes.data(), static_cast<int>(codes.size()), rounded.data());
  std::vector<std::int32_t> starts;
  for (int i = 0; i < kPatches; ++i) starts.push_back(code_size * i);
  const auto outputs = static_cast<std::size_t>(layer.outputs);
  std::vector<float> all(kPatches * outputs);
  multiply_patches(patch_layer, rounded.data(), row_step, starts.data(), kPatches, all.data());
  for (int n = 1; n < kPatches; ++n) {
    std::vector<float> out(static_cast<std::size_t>(n) * outputs);
    multiply_patches(patch_layer, rounded.data(), row_step, starts.data(), n, out.data());
    EXPECT_TRUE(std::equal(out.begin(), out.end(), all.begin())) << n << " patches";
  }
  for (std::size_t patch = 0; patch < kPatches; ++patch) {
    for (std::size_t o = 0; o < outputs; ++o) {
      double sum = static_cast<double>(layer.bias[o]);
      double rounding = 1e-5;
      for (int i = 0; i < layer.inputs; ++i) {
        const int width = layer.inputs / rows;
        const double code = static_cast<double>(
            codes[static_cast<std::size_t>(starts[patch] + i / width * row_step + i % width)]);
        const auto weight =
            static_cast<double>(layer.weights[static_cast<std::size_t>(i) * outputs + o]);
        const double steps = 1.0 / static_cast<double>(patch_layer.scale[o] * kCodeSteps);
        sum += code * weight;
        rounding +=
            0.5 * std::abs(weight) / static_cast<double>(kCodeSteps) + 0.5 * (code + 1e-3) / steps;
      }
      EXPECT_NEAR(static_cast<double>(all[patch * outputs + o]), std::max(sum, 0.0), rounding)
          << "patch " << patch << ", output " << o << ", seed " << kSeed;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(HeadsAndScreen, PatchLayerOf,
                         ::testing::Values(ClassifierNetwork::kJudge.head,
                                           ClassifierNetwork::kScreen,
                                           ClassifierNetwork::kReviewer.head));

TEST(PatchLayer, TheLargestCodesDoNotOverflow) {
  const ClassifierNetwork network = shipped_classifier_network();
  DenseLayer layer = network.layers[ClassifierNetwork::kJudge.head];
  for (float& weight : layer.weights) weight = std::abs(weight);
  std::fill(layer.bias.begin(), layer.bias.end(), 0.0F);
  const PatchLayer patch_layer(layer, kPatch);
  const std::vector<float> huge(kPatch * kPatch * ClassifierNetwork::kJudge.code, 1e30F);
  std::vector<std::int16_t> codes(huge.size());
  round_codes(huge.data(), static_cast<int>(huge.size()), codes.data());
  EXPECT_EQ(codes.front(), kMaxCode);
  std::vector<float> out(static_cast<std::size_t>(layer.outputs));
  const std::int32_t start = 0;
  multiply_patches(patch_layer, codes.data(), kPatch * ClassifierNetwork::kJudge.code, &start, 1,
                   out.data());
  for (std::size_t o = 0; o < out.size(); ++o) {
    double sum = 0.0;
    for (std::size_t i = o; i < layer.weights.size(); i += out.size())
      sum += static_cast<double>(layer.weights[i]);
    const double expected = sum * kMaxCode / static_cast<double>(kCodeSteps);
    EXPECT_NEAR(static_cast<double>(out[o]) / expected, 1.0, 1e-3);
  }
}

TEST(TakeExponentials, AreExponentials) {
  std::vector<float> x(64);
  for (std::size_t i = 0; i < x.size(); ++i) x[i] = -16.0F + 0.5F * static_cast<float>(i);
  std::vector<float> y(x.size());
  take_exponentials(x.data(), static_cast<int>(x.size()), y.data());
  for (std::size_t i = 0; i < x.size(); ++i) EXPECT_NEAR(y[i] / std::exp(x[i]), 1.0F, 1e-6F);
}

}  // namespace
}  // namespace curlew
