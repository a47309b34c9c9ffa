#include "service/detection_training.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>

#include "acquisition/random_stream.h"
#include "detect/vortex_classifier.h"
#include "service/classifier_optimiser.h"
#include "service/detection_measurement.h"
#include "service/spot_camera.h"
#include "tests/support/allocation_counter.h"
#include "tests/support/scratch_directory.h"

namespace curlew {
namespace {

constexpr std::uint64_t kSeed = 3;

TEST(ClassifierOptimiser, DescendsToWhatItIsShown) {
  // Outputs that are linear in a few inputs: least squares, the gradient is the residual.
  constexpr int kBatch = 32;
  ClassifierNetwork network;
  RandomStream random(kSeed, 0);
  for (DenseLayer& layer : network.layers) {
    for (float& weight : layer.weights)
      weight = static_cast<float>(random.gaussian() * std::sqrt(2.0 / layer.inputs));
  }
  ClassifierOptimiser optimiser(network, 0, ClassifierNetwork::kHeadEnd, kBatch);
  const auto outputs =
      static_cast<std::size_t>(ClassifierNetwork::kOutputs[ClassifierNetwork::kHeadEnd - 1]);
  double first = 0.0;
  double last = 0.0;
  for (int step = 0; step < 400; ++step) {
    constexpr std::size_t kInputs = kPatchLenslets * kSpotFeatures;
    for (std::size_t i = 0; i < kBatch * kInputs; ++i)
      optimiser.inputs()[i] = static_cast<float>(random.gaussian());
    const float* output = optimiser.run();
    double loss = 0.0;
    for (std::size_t i = 0; i < kBatch; ++i) {
      const float target = optimiser.inputs()[i * kInputs];
      for (std::size_t o = 0; o < outputs; ++o) {
        const float residual = output[i * outputs + o] - target;
        optimiser.output_gradient()[i * outputs + o] = residual / kBatch;
        loss += static_cast<double>(residual * residual);
      }
    }
    if (step < 20) first += loss;
    if (step >= 380) last += loss;
    optimiser.step(2e-3);
  }
  EXPECT_LT(last, 0.5 * first);
}

TEST(TrainVortexClassifier, SameOptionsSameWeights) {
  const ScratchDirectory folder;
  const RealisationCache cache(folder.path());
  TrainingOptions options;
  options.fields = 2;
  options.validation_fields = 1;
  options.validation_lenslets = 16;
  options.steps = 24;
  options.batch = 64;
  const TrainingReport a = train_vortex_classifier(options, cache, [](const std::string&) {});
  const TrainingReport b = train_vortex_classifier(options, cache, [](const std::string&) {});
  EXPECT_EQ(weights_text(a, "x"), weights_text(b, "x"));
  EXPECT_NE(weights_text(a, "x").find("version 1"), std::string::npos);
  for (const DenseLayer& layer : a.network.layers) {
    EXPECT_TRUE(std::all_of(layer.weights.begin(), layer.weights.end(),
                            [](float weight) { return std::isfinite(weight); }));
  }
}

TEST(TrainingFields, NeverComeFromTheOtherSubsets) {
  EXPECT_LT(realisation_seed(Subset::kTraining, 999'999), realisation_seed(Subset::kValidation, 0));
  EXPECT_LT(realisation_seed(Subset::kTraining, 999'999), realisation_seed(Subset::kTest, 0));
}

TEST(ClassifyVortices, AllocatesNothing) {
  FieldParameters parameters;
  parameters.rytov_variance = 2.0;
  const MeasurementPlan plan(parameters, {});
  const Realisation realisation = simulate_realisation(parameters, kSeed);
  MeasuredFrame frame(plan);
  measure_frame(plan, realisation, kSeed, frame);
  for (const double min_scout : {-1e30, -2.0}) {
    const ClassifierPlan classifier({.min_probability = 0.02, .min_scout = min_scout},
                                    spot_camera(plan.sensor()), plan.format());
    ClassifierWorkspace workspace(classifier);
    VortexList vortices(64);
    EXPECT_EQ(allocations_of_this_thread([&] {
                classify_vortices(classifier, frame.frame.view(), frame.centroids,
                                  frame.circulation, workspace, vortices);
              }),
              0);
    EXPECT_FALSE(vortices.empty());
  }
}

}  // namespace
}  // namespace curlew
