#include "service/training/detection_training.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "acquisition/simulator/random_stream.h"
#include "detect/classifier/vortex_classifier.h"
#include "service/bench/detection_measurement.h"
#include "service/bench/detection_score.h"
#include "service/spot_camera.h"
#include "service/training/classifier_optimiser.h"
#include "service/training/network_symmetry.h"
#include "service/training/training_fields.h"
#include "service/training/training_lessons.h"
#include "tests/support/allocation_counter.h"
#include "tests/support/scratch_directory.h"

namespace curlew {
namespace {

constexpr std::uint64_t kSeed = 3;
constexpr JudgeLayers kReviewer = ClassifierNetwork::kReviewer;
constexpr std::size_t kReviewerLayers = kReviewer.end - kReviewer.encoder;

TEST(ClassifierOptimiser, DescendsToWhatItIsShown) {
  // The targets are linear in a few inputs. For least squares the gradient is the residual.
  constexpr int kBatch = 32;
  ClassifierNetwork network;
  RandomStream random(kSeed, 0);
  for (DenseLayer& layer : network.layers) {
    for (float& weight : layer.weights)
      weight = static_cast<float>(random.gaussian() * std::sqrt(2.0 / layer.inputs));
  }
  ClassifierOptimiser optimiser(network, ClassifierNetwork::kJudge.encoder,
                                ClassifierNetwork::kJudge.end, kBatch);
  constexpr std::size_t outputs = kFirstPairOutput + kPairOutputs;
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

// A network whose numbers are the means over the symmetries of random ones says the same of a patch
// and of the patch turned: equal logits, turned positions and, if it is mirrored, the other charge.
TEST(NetworkSymmetry, TurnedPatchesHaveTurnedAnswers) {
  const std::vector<Symmetry> all = all_symmetries();
  ASSERT_EQ(all.size(), 8U);
  const int patches = static_cast<int>(all.size());
  ClassifierNetwork network;
  RandomStream random(kSeed, 1);
  const NetworkSymmetry symmetry(kReviewer);
  for (std::size_t i = 0; i < kReviewerLayers; ++i) {
    DenseLayer& layer = network.layers[kReviewer.encoder + i];
    for (AlignedVector<float>* numbers : {&layer.weights, &layer.bias})
      for (float& number : *numbers) number = static_cast<float>(random.gaussian() * 0.3);
    symmetry.symmetrise(i, layer.weights, layer.bias);
    const AlignedVector<float> once = layer.weights;
    symmetry.symmetrise(i, layer.weights, layer.bias);
    for (std::size_t k = 0; k < once.size(); ++k)
      ASSERT_NEAR(layer.weights[k], once[k], 1e-6F) << "layer " << i;
  }
  ClassifierOptimiser optimiser(network, kReviewer.encoder, kReviewer.end, patches);
  std::vector<float> patch(kPatchLenslets * kTaughtInputs);
  for (float& input : patch) input = static_cast<float>(random.gaussian());
  constexpr std::size_t kInputs = kPatchLenslets * kTaughtInputs;
  for (std::size_t s = 0; s < all.size(); ++s) {
    for (std::size_t i = 0; i < kInputs; ++i) {
      const auto lenslet = static_cast<std::size_t>(all[s].lenslet[i / kTaughtInputs]);
      const std::size_t input = i % kTaughtInputs;
      const std::size_t feature = input % kSpotFeatures;
      const bool of_spot = input + 1 < kTaughtInputs;
      const std::size_t from =
          of_spot ? input - feature + static_cast<std::size_t>(all[s].feature[feature]) : input;
      optimiser.inputs()[s * kInputs + i] =
          patch[lenslet * kTaughtInputs + from] * (of_spot ? all[s].sign[feature] : 1.0F);
    }
  }
  const float* output = optimiser.run();
  constexpr std::size_t kAnswers = kFirstPairOutput + kPairOutputs;
  const auto unturned = static_cast<std::size_t>(
      std::find_if(all.begin(), all.end(),
                   [](const Symmetry& s) { return !s.transpose && s.sx == 1 && s.sy == 1; }) -
      all.begin());
  const float* const original = output + unturned * kAnswers;
  EXPECT_GT(std::abs(original[0] - original[kNodeOutputs]), 0.01F);
  for (std::size_t s = 0; s < all.size(); ++s) {
    SCOPED_TRACE(s);
    const float* const turned = output + s * kAnswers;
    for (const std::size_t first :
         {std::size_t{0}, std::size_t{kNodeOutputs}, std::size_t{kFirstPairOutput}}) {
      const bool swapped = all[s].mirrors() && first != kFirstPairOutput;
      const float* const from = original + (swapped ? kNodeOutputs - first : first);
      const Label expected =
          all[s]({.present = from[0], .weight = 1.0F, .dx = from[1], .dy = from[2]});
      EXPECT_NEAR(turned[first], expected.present, 1e-4F);
      EXPECT_NEAR(turned[first + 1], expected.dx, 1e-4F);
      EXPECT_NEAR(turned[first + 2], expected.dy, 1e-4F);
      if (all[s].transpose) continue;
      EXPECT_NEAR(turned[first + 3], from[3], 1e-4F);
      if (first == kFirstPairOutput) continue;
      EXPECT_NEAR(turned[first + 4], from[4] * static_cast<float>(all[s].sx * all[s].sy), 1e-4F);
      EXPECT_NEAR(turned[first + 5], from[5], 1e-4F);
    }
  }
}

/// Holds a reviewer's weights and biases against their means over the symmetries.
void expect_symmetrical(const ClassifierNetwork& network) {
  const NetworkSymmetry symmetry(kReviewer);
  for (std::size_t i = 0; i < kReviewerLayers; ++i) {
    SCOPED_TRACE(i);
    const DenseLayer& layer = network.layers[kReviewer.encoder + i];
    DenseLayer mean = layer;
    symmetry.symmetrise(i, mean.weights, mean.bias);
    // Numbers in the file have five digits.
    for (const auto& [is, of_mean] :
         {std::pair{&layer.weights, &mean.weights}, std::pair{&layer.bias, &mean.bias}}) {
      float largest = 0.0F;
      for (const float number : *is) largest = std::max(largest, std::abs(number));
      for (std::size_t k = 0; k < is->size(); ++k)
        ASSERT_NEAR((*of_mean)[k], (*is)[k], 2e-4F * largest) << k;
    }
  }
}

TEST(NetworkSymmetry, TheShippedReviewerHasIt) { expect_symmetrical(shipped_classifier_network()); }

/// Returns options for a training of seconds, which teaches nothing useful.
TrainingOptions short_training() {
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
  return options;
}

TEST(TrainVortexClassifier, SameOptionsSameWeights) {
  const ScratchDirectory folder;
  const RealisationCache cache(folder.path());
  TrainingOptions options = short_training();
  const TrainingReport a = train_vortex_classifier(options, cache, [](const std::string&) {});
  EXPECT_NE(weights_text(a, options, "x").find("version 4"), std::string::npos);
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
  EXPECT_EQ(weights_text(a, options, "x"), weights_text(b, options, "x"));
  options.seed += 1;
  const TrainingReport c = train_vortex_classifier(options, cache, [](const std::string&) {});
  EXPECT_NE(weights_text(a, options, "x"), weights_text(c, options, "x"));
#endif
}

TEST(TrainVortexClassifier, TheReviewerAloneCanBeTrained) {
  const ScratchDirectory folder;
  const RealisationCache cache(folder.path());
  TrainingOptions options = short_training();
  options.reviewer = true;
  const TrainingReport report = train_vortex_classifier(options, cache, [](const std::string&) {});
  const ClassifierNetwork shipped = shipped_classifier_network();
  for (int i = 0; i < ClassifierNetwork::kLayers; ++i) {
    const auto layer = static_cast<std::size_t>(i);
    EXPECT_EQ(report.network.layers[layer].weights != shipped.layers[layer].weights,
              i >= kReviewer.encoder)
        << i;
  }
  expect_symmetrical(report.network);
  // The file that is compiled in has the trained numbers only.
  std::size_t numbers = 0;
  for (std::size_t i = static_cast<std::size_t>(kReviewer.encoder); i < shipped.layers.size(); ++i)
    numbers += shipped.layers[i].weights.size() + shipped.layers[i].bias.size();
  const std::string text = weights_text(report, options, "x");
  std::size_t written = 0;
  for (std::size_t at = 0; (at = text.find("F,", at)) != std::string::npos; ++at) ++written;
  EXPECT_EQ(written, numbers);
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
