#include "service/training/detection_training.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

#include "acquisition/simulator/random_stream.h"
#include "detect/classifier/vortex_classifier.h"
#include "service/bench/detection_measurement.h"
#include "service/bench/detection_score.h"
#include "service/spot_camera.h"
#include "service/training/classifier_optimiser.h"
#include "service/training/training_fields.h"
#include "tests/support/allocation_counter.h"
#include "tests/support/scratch_directory.h"

namespace curlew {
namespace {

constexpr std::uint64_t kSeed = 3;

TEST(ClassifierOptimiser, DescendsToWhatItIsShown) {
  // The targets are linear in a few inputs. For least squares the gradient is the residual.
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
    constexpr std::size_t kInputs = kPatchLenslets * kTaughtInputs;
    // As for the benchmark's sensor, the inputs after a spot's features are 0.
    for (std::size_t i = 0; i < kBatch * kInputs; ++i)
      if (i % kTaughtInputs < kSpotFeatures)
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
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  options.validation_lenslets = 8;
  options.steps = 4;  // Every step is the same work for the same threads.
  options.batch = 16;
#else
  options.validation_lenslets = 16;
  options.steps = 24;
  options.batch = 64;
#endif
  const TrainingReport a = train_vortex_classifier(options, cache, [](const std::string&) {});
  EXPECT_NE(weights_text(a, "x").find("version 4"), std::string::npos);
  for (const DenseLayer& layer : a.network.layers) {
    EXPECT_TRUE(std::all_of(layer.weights.begin(), layer.weights.end(),
                            [](float weight) { return std::isfinite(weight); }));
    EXPECT_TRUE(std::any_of(layer.weights.begin(), layer.weights.end(), [](float weight) {
      return weight != 0.0F;
    })) << "this layer was never trained";
  }
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
  // A sanitizer has seen everything in the first training, which takes it a minute.
  const TrainingReport b = train_vortex_classifier(options, cache, [](const std::string&) {});
  EXPECT_EQ(weights_text(a, "x"), weights_text(b, "x"));
  options.seed += 1;
  const TrainingReport c = train_vortex_classifier(options, cache, [](const std::string&) {});
  EXPECT_NE(weights_text(a, "x"), weights_text(c, "x"));
#endif
}

TEST(TrainingFields, NeverComeFromTheOtherSubsets) {
  EXPECT_LT(realisation_seed(Subset::kTraining, 999'999), realisation_seed(Subset::kValidation, 0));
  EXPECT_LT(realisation_seed(Subset::kTraining, 999'999), realisation_seed(Subset::kTest, 0));
}

TEST(UnresolvedPairs, AreTheClosestAndClearOfOthers) {
  std::vector<SceneVortex> vortices;
  const auto add = [&](double x, double y, int charge) {
    vortices.push_back({.x = x, .y = y, .charge = charge});
  };
  add(3.0, 3.0, 1);  // its partner is the next one, .6 apart
  add(3.6, 3.0, -1);
  add(8.0, 8.0, 1);  // .8 from the next, which pairs with the one after it, .5 apart
  add(8.8, 8.0, -1);
  add(9.3, 8.0, 1);
  add(12.0, 3.0, 1);  // 1.2 from the next, so both are required
  add(13.2, 3.0, -1);
  const auto pairs = unresolved_pairs(grade_vortices(vortices));
  ASSERT_EQ(pairs.size(), 2U);
  EXPECT_NEAR(pairs[0].separation, 0.5, 1e-12);
  EXPECT_NEAR(pairs[0].x, 9.05, 1e-12);
  EXPECT_TRUE(pairs[0].clear);  // the third of the group is 1.05 from the middle
  EXPECT_NEAR(pairs[1].separation, 0.6, 1e-12);
  EXPECT_NEAR(pairs[1].x, 3.3, 1e-12);
  EXPECT_TRUE(pairs[1].clear);
}

TEST(ClassifyVortices, ProbabilitiesAreFrequencies) {
  // The fields are of the validation subset. They have 150 or so candidates, so that the share of
  // hits has a standard error of .03 at most. Fields differ, and neighbouring candidates are not
  // independent.
  FieldParameters parameters;
  parameters.rytov_variance = 2.0;
  parameters.rows = parameters.cols = 60;
  const MeasurementPlan plan(parameters, {});
  const ClassifierPlan classifier({.min_probability = 0.05}, spot_camera(plan.sensor()),
                                  plan.format());
  ClassifierWorkspace workspace(classifier);
  VortexList vortices(1024);
  MeasuredFrame frame(plan);
  double predicted = 0.0;
  double hits = 0.0;
  double candidates = 0.0;
  for (int i = 0; i < 2; ++i) {
    const std::uint64_t seed = realisation_seed(Subset::kValidation, i);
    const Realisation realisation = simulate_realisation(parameters, seed);
    measure_frame(plan, realisation, seed, frame);
    find_classified_vortices(classifier, frame.frame.view(), frame.shift(), frame.centroids,
                             frame.circulation, workspace, vortices);
    const FrameVerdicts frame_verdicts = judge_frame(
        candidates_by_probability(vortices), grade_vortices(realisation.vortices), {60, 60});
    for (const Verdict& verdict : frame_verdicts.verdicts) {
      predicted += verdict.score;
      hits += verdict.hit ? 1.0 : 0.0;
      candidates += 1.0;
    }
  }
  ASSERT_GT(candidates, 60.0);
  EXPECT_NEAR(predicted / candidates, hits / candidates, 0.12);
}

TEST(ClassifyVortices, AllocatesNothing) {
  FieldParameters parameters;
  parameters.rytov_variance = 2.0;
  const MeasurementPlan plan(parameters, {});
  const Realisation realisation = simulate_realisation(parameters, kSeed);
  MeasuredFrame frame(plan);
  measure_frame(plan, realisation, kSeed, frame);
  for (const double min_scout : {2.0 * kEveryNode, -2.0}) {
    const ClassifierPlan classifier({.min_probability = 0.02, .min_scout = min_scout},
                                    spot_camera(plan.sensor()), plan.format());
    ClassifierWorkspace workspace(classifier);
    VortexList vortices(64);
    EXPECT_EQ(allocations_of_this_thread([&] {
                find_classified_vortices(classifier, frame.frame.view(), frame.shift(),
                                         frame.centroids, frame.circulation, workspace, vortices);
              }),
              0);
    EXPECT_FALSE(vortices.empty());
  }
}

}  // namespace
}  // namespace curlew
