#include "service/scout_training.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <map>
#include <memory>
#include <numbers>
#include <tuple>
#include <utility>

#include "acquisition/random_stream.h"
#include "detect/vortex_classifier.h"
#include "service/classifier_optimiser.h"
#include "service/detection_measurement.h"
#include "service/spot_camera.h"

namespace curlew {
namespace {

/// Plans for frames like a field's, one a geometry and flux.
class MeasurementPlans {
 public:
  const MeasurementPlan& of(const FieldParameters& p, double photons) {
    std::unique_ptr<MeasurementPlan>& plan =
        plans_[{p.lenslet, p.window_px, p.samples_per_lambda_w, photons}];
    if (!plan) {
      MeasurementOptions options;
      options.photons = photons;
      plan = std::make_unique<MeasurementPlan>(p, options);
    }
    return *plan;
  }

 private:
  std::map<std::tuple<double, int, double, double>, std::unique_ptr<MeasurementPlan>> plans_;
};

struct ScoutLesson {
  std::array<float, kScoutFeatures> inputs;
  float found;  // 1: the network sees a vortex from this node
};

std::vector<ScoutLesson> scout_lessons(std::vector<TrainingField>& fields,
                                       const ClassifierNetwork& network) {
  constexpr std::size_t kMostFields = 120;
  constexpr float kFound = 0.1F;
  constexpr float kBestView = 0.5F;  // of the most that a neighbour gives the same vortex
  constexpr std::array<double, 4> kPhotons{kWithoutNoise, 1000.0, 200.0, 450.0};
  MeasurementPlans plans;
  std::vector<ScoutLesson> lessons;
  for (std::size_t i = 0; i < std::min(kMostFields, fields.size()); ++i) {
    TrainingField& field = fields[i];
    // Fields come in fives of a geometry, tens of geometries.
    const MeasurementPlan& plan = plans.of(field.parameters, kPhotons[(i + i / 50) % 4]);
    Realisation realisation{std::move(field.light), {}};
    MeasuredFrame frame(plan);
    measure_frame(plan, realisation, realisation_seed(Subset::kTraining, static_cast<int>(i)),
                  frame);
    field.light = std::move(realisation.light);
    const ClassifierPlan classifier({.min_probability = 0.02, .min_scout = 2.0 * kEveryNode},
                                    spot_camera(plan.sensor()), plan.format(), network);
    ClassifierWorkspace workspace(classifier);
    VortexList found(field.light.size());
    classify_vortices(classifier, frame.frame.view(), frame.centroids, frame.circulation, workspace,
                      found);
    const int rows = classifier.rows() - 1;
    const int cols = classifier.cols() - 1;
    Image<std::array<float, 3>> probability(rows, cols);
    for (const NodeVortex& seen : workspace.seen) {
      const int kind = seen.vortex.charge + 1;
      probability(seen.row, seen.col)[static_cast<std::size_t>(kind)] = seen.vortex.probability;
    }
    const auto deserves = [&](int row, int col) {
      for (std::size_t kind = 0; kind < 3; ++kind) {
        const float here = probability(row, col)[kind];
        bool best = here >= kFound;
        for (int r = row - 1; r <= row + 1; ++r)
          for (int c = col - 1; c <= col + 1; ++c)
            best =
                best && !(probability.contains(r, c) && here < kBestView * probability(r, c)[kind]);
        if (best) return true;
      }
      return false;
    };
    describe_lenslets(frame.centroids, frame.circulation, mean_flux(frame.centroids),
                      classifier.pixels_per_lambda_w(), workspace.scout);
    for (int row = 0; row < rows; ++row) {
      describe_nodes(row, workspace.scout);
      for (int col = 0; col < cols; ++col) {
        ScoutLesson& lesson = lessons.emplace_back();
        for (int f = 0; f < kScoutFeatures; ++f)
          lesson.inputs[static_cast<std::size_t>(f)] = workspace.scout.features(f, col);
        lesson.found = deserves(row, col) ? 1.0F : 0.0F;
      }
    }
  }
  return lessons;
}

}  // namespace

void train_scout(std::vector<TrainingField>& fields, std::uint64_t seed, ClassifierNetwork& network,
                 const std::function<void(const std::string&)>& log) {
  const std::vector<ScoutLesson> lessons = scout_lessons(fields, network);
  constexpr int kBatch = 1024;
  constexpr int kSteps = 3000;
  constexpr double kRate = 5e-3;
  RandomStream random(seed, 2);
  ClassifierOptimiser optimiser(network, ClassifierNetwork::kHeadEnd, ClassifierNetwork::kLayers,
                                kBatch);
  constexpr auto kOut = static_cast<std::size_t>(ClassifierNetwork::kOutputs.back());
  std::array<float, kBatch> found{};
  for (int step = 0; step < kSteps; ++step) {
    for (std::size_t i = 0; i < kBatch; ++i) {
      const auto pick =
          static_cast<std::size_t>(random.uniform() * static_cast<double>(lessons.size()));
      std::copy_n(lessons[pick].inputs.data(), kScoutFeatures,
                  optimiser.inputs() + i * kScoutFeatures);
      found[i] = lessons[pick].found;
    }
    const float* output = optimiser.run();
    float* gradient = optimiser.output_gradient();
    std::fill_n(gradient, kBatch * kOut, 0.0F);
    for (std::size_t i = 0; i < kBatch; ++i)
      gradient[i * kOut] = (1.0F / (1.0F + std::exp(-output[i * kOut])) - found[i]) / kBatch;
    optimiser.step(kRate * 0.5 * (1.0 + std::cos(std::numbers::pi * step / kSteps)));
  }
  std::vector<float> with, all;
  for (std::size_t first = 0; first + kBatch <= lessons.size(); first += kBatch) {
    for (std::size_t i = 0; i < kBatch; ++i)
      std::copy_n(lessons[first + i].inputs.data(), kScoutFeatures,
                  optimiser.inputs() + i * kScoutFeatures);
    const float* output = optimiser.run();
    for (std::size_t i = 0; i < kBatch; ++i) {
      all.push_back(output[i * kOut]);
      if (lessons[first + i].found > 0.0F) with.push_back(output[i * kOut]);
    }
  }
  if (with.empty()) return;
  std::sort(with.begin(), with.end());
  for (const double lost : {0.002, 0.005, 0.01, 0.02}) {
    const float least = with[static_cast<std::size_t>(lost * static_cast<double>(with.size()))];
    const auto kept = std::count_if(all.begin(), all.end(), [&](float z) { return z >= least; });
    log(fmt::format(
        "scout from {:.2f}: loses {:.1f} % of {} nodes with a vortex, keeps {:.1f} % of {}", least,
        100.0 * lost, with.size(),
        100.0 * static_cast<double>(kept) / static_cast<double>(all.size()), all.size()));
  }
}

}  // namespace curlew
