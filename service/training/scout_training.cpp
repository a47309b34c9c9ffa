#include "service/training/scout_training.h"

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

#include "acquisition/simulator/random_stream.h"
#include "detect/classifier/vortex_classifier.h"
#include "service/bench/detection_measurement.h"
#include "service/spot_camera.h"
#include "service/training/classifier_optimiser.h"
#include "service/training/training_exposures.h"

namespace curlew {
namespace {

/// Plans for frames of training fields, one for each kind of sensor.
class MeasurementPlans {
 public:
  const MeasurementPlan& of(const FieldParameters& p, const MeasurementOptions& options) {
    std::unique_ptr<MeasurementPlan>& plan =
        plans_[{p.lenslet, p.window_px, options.photons, options.blur, options.faded}];
    if (!plan) plan = std::make_unique<MeasurementPlan>(p, options);
    return *plan;
  }

 private:
  std::map<std::tuple<double, int, double, double, double>, std::unique_ptr<MeasurementPlan>>
      plans_;
};

/// What a gate gets of each node, and whether it should let the node pass.
struct GateLessons {
  std::size_t size() const { return found.size(); }

  std::size_t width;          // inputs of one lesson
  std::vector<float> inputs;  // [lessons, width]
  std::vector<float> found;   // [lessons]; 1: the network sees a vortex from this node
};

constexpr std::size_t kMaxFields = 150;

/// Returns how field i is seen. Every other field is seen as the benchmark sees it, the others
/// blurred, with lenslets that have faded or, if they are wide enough, through coarse pixels.
/// Without noise nothing fades.
MeasurementOptions options_of_field(std::size_t i, bool coarse) {
  constexpr std::array<double, 4> kPhotons{kWithoutNoise, 1000.0, 200.0, 450.0};
  constexpr std::array<double, 3> kBlurs{0.2, 0.4, 0.6};
  MeasurementOptions options;
  // The shifts give the same geometries other fluxes in the next rounds.
  options.photons = kPhotons[(i + i / 10 + i / 100) % 4];
  if (i % 2 == 0) return options;
  if (!coarse) options.blur = kBlurs[i / 2 % 3];
  if (i % 5 == 0) options.faded = 0.05;
  return options;
}

/// Exposes the fields and calls use(classifier, frame, workspace, found). The classifier has judged
/// the nodes that the scout gives min_scout or more; found is 1 where it sees a vortex well.
template <typename Use>
void see_fields(const std::vector<TrainingField>& fields, const ClassifierNetwork& network,
                double min_scout, Use&& use) {
  constexpr float kFound = 0.1F;
  // At least this part of what a neighbouring node gives the same vortex.
  constexpr float kBestView = 0.5F;
  MeasurementPlans plans;
  for (std::size_t i = 0; i < std::min(kMaxFields, fields.size()); ++i) {
    const TrainingField& field = fields[i];
    const bool coarse = i % 4 == 3 && field.parameters.window_px > kNarrowWindow_px;
    const DrawnSensor sensor = plain_sensor(field, coarse);
    const MeasurementPlan& plan = plans.of(sensor.parameters, options_of_field(i, coarse));
    MeasuredFrame frame(plan);
    measure_frame(plan, {sensor.light, {}},
                  realisation_seed(Subset::kTraining, static_cast<int>(i)), frame);
    const ClassifierPlan classifier(
        {.min_probability = 0.02, .min_scout = min_scout, .as_trained = true},
        spot_camera(plan.sensor()), plan.format(), network);
    ClassifierWorkspace workspace(classifier);
    VortexList vortices(2 * sensor.missing.size());
    find_classified_vortices(classifier, frame.frame.view(), frame.shift(), frame.centroids,
                             frame.circulation, workspace, vortices);
    const int rows = classifier.rows() - 1;
    const int cols = classifier.cols() - 1;
    Image<std::array<float, 3>> probability(rows, cols);
    for (const NodeVortex& seen : workspace.views.seen) {
      const int kind = seen.vortex.charge + 1;
      probability(seen.row, seen.col)[static_cast<std::size_t>(kind)] = seen.vortex.probability;
    }
    Image<float> found(rows, cols);
    for (int row = 0; row < rows; ++row) {
      for (int col = 0; col < cols; ++col) {
        for (std::size_t kind = 0; kind < 3; ++kind) {
          const float here = probability(row, col)[kind];
          bool best = here >= kFound;
          for (int r = row - 1; r <= row + 1; ++r)
            for (int c = col - 1; c <= col + 1; ++c)
              best = best &&
                     !(probability.contains(r, c) && here < kBestView * probability(r, c)[kind]);
          if (best) found(row, col) = 1.0F;
        }
      }
    }
    use(classifier, frame, workspace, found);
  }
}

GateLessons scout_lessons(const std::vector<TrainingField>& fields,
                          const ClassifierNetwork& network) {
  GateLessons lessons{kScoutFeatures, {}, {}};
  see_fields(fields, network, 2.0 * kEveryNode,
             [&](const ClassifierPlan& classifier, const MeasuredFrame& frame,
                 ClassifierWorkspace& workspace, const Image<float>& found) {
               describe_lenslets(frame.centroids, frame.circulation, mean_flux(frame.centroids),
                                 classifier.pixels_per_lambda_w(),
                                 classifier.judge().codings.as_calibrated().excess_spread,
                                 workspace.scout);
               for (int row = 0; row < found.rows(); ++row) {
                 describe_nodes(row, workspace.scout);
                 for (int col = 0; col < found.cols(); ++col) {
                   for (int f = 0; f < kScoutFeatures; ++f)
                     lessons.inputs.push_back(workspace.scout.features(f, col));
                   lessons.found.push_back(found(row, col));
                 }
               }
             });
  return lessons;
}

/// Returns the lessons of the nodes that the trained scout lets pass.
GateLessons screen_lessons(const std::vector<TrainingField>& fields,
                           const ClassifierNetwork& network) {
  constexpr int kCode = ClassifierNetwork::kJudge.code;
  constexpr int kInset = (kPatch - kScreenPatch) / 2;
  GateLessons lessons{std::size_t{kScreenPatch} * kScreenPatch * kCode, {}, {}};
  see_fields(fields, network, ClassifierOptions{}.min_scout,
             [&](const ClassifierPlan&, const MeasuredFrame&, const ClassifierWorkspace& workspace,
                 const Image<float>& found) {
               for (const std::int32_t node : workspace.nodes) {
                 const int row = node / found.cols();
                 const int col = node % found.cols();
                 for (int r = row + kInset; r < row + kInset + kScreenPatch; ++r) {
                   const float* codes = &workspace.judged.exact(r, (col + kInset) * kCode);
                   lessons.inputs.insert(lessons.inputs.end(), codes,
                                         codes + std::ptrdiff_t{kScreenPatch} * kCode);
                 }
                 lessons.found.push_back(found(row, col));
               }
             });
  return lessons;
}

/// Trains layers [first, last), the last of which gives a logit, and logs what thresholds would
/// cost.
void train_gate(const char* name, const GateLessons& lessons, RandomStream random, int first,
                int last, ClassifierNetwork& network,
                const std::function<void(const std::string&)>& log) {
  if (std::none_of(lessons.found.begin(), lessons.found.end(), [](float f) { return f > 0.0F; })) {
    log(fmt::format("{}: no node with a vortex to learn from, so it stops none", name));
    for (auto layer = static_cast<std::size_t>(first); layer < static_cast<std::size_t>(last);
         ++layer) {
      std::fill(network.layers[layer].weights.begin(), network.layers[layer].weights.end(), 0.0F);
      std::fill(network.layers[layer].bias.begin(), network.layers[layer].bias.end(), 0.0F);
    }
    return;
  }
  constexpr int kBatch = 1024;
  constexpr int kSteps = 3000;
  constexpr double kRate = 5e-3;
  ClassifierOptimiser optimiser(network, first, last, kBatch);
  const auto out =
      static_cast<std::size_t>(network.layers[static_cast<std::size_t>(last - 1)].outputs);
  const auto take = [&](std::size_t lesson, std::size_t to) {
    std::copy_n(lessons.inputs.data() + lesson * lessons.width, lessons.width,
                optimiser.inputs() + to * lessons.width);
  };
  std::array<float, kBatch> found{};
  for (int step = 0; step < kSteps; ++step) {
    for (std::size_t i = 0; i < kBatch; ++i) {
      const auto pick =
          static_cast<std::size_t>(random.uniform() * static_cast<double>(lessons.size()));
      take(pick, i);
      found[i] = lessons.found[pick];
    }
    const float* output = optimiser.run();
    float* gradient = optimiser.output_gradient();
    std::fill_n(gradient, kBatch * out, 0.0F);
    for (std::size_t i = 0; i < kBatch; ++i)
      gradient[i * out] = (1.0F / (1.0F + std::exp(-output[i * out])) - found[i]) / kBatch;
    optimiser.step(kRate * 0.5 * (1.0 + std::cos(std::numbers::pi * step / kSteps)));
  }
  std::vector<float> with, all;
  for (std::size_t from = 0; from + kBatch <= lessons.size(); from += kBatch) {
    for (std::size_t i = 0; i < kBatch; ++i) take(from + i, i);
    const float* output = optimiser.run();
    for (std::size_t i = 0; i < kBatch; ++i) {
      all.push_back(output[i * out]);
      if (lessons.found[from + i] > 0.0F) with.push_back(output[i * out]);
    }
  }
  if (with.empty()) return;
  std::sort(with.begin(), with.end());
  for (const double lost : {0.002, 0.005, 0.01, 0.02}) {
    const float minimum = with[static_cast<std::size_t>(lost * static_cast<double>(with.size()))];
    const auto kept = std::count_if(all.begin(), all.end(), [&](float z) { return z >= minimum; });
    log(fmt::format(
        "{} from {:.2f}: loses {:.1f} % of {} nodes with a vortex, keeps {:.1f} % of {}", name,
        minimum, 100.0 * lost, with.size(),
        100.0 * static_cast<double>(kept) / static_cast<double>(all.size()), all.size()));
  }
}

}  // namespace

void train_scout(const std::vector<TrainingField>& fields, std::uint64_t seed,
                 ClassifierNetwork& network, const std::function<void(const std::string&)>& log) {
  train_gate("scout", scout_lessons(fields, network), RandomStream(seed, 2),
             ClassifierNetwork::kScout, ClassifierNetwork::kScreen, network, log);
}

void train_screen(const std::vector<TrainingField>& fields, std::uint64_t seed,
                  ClassifierNetwork& network, const std::function<void(const std::string&)>& log) {
  train_gate("screen", screen_lessons(fields, network), RandomStream(seed, 3),
             ClassifierNetwork::kScreen, ClassifierNetwork::kReviewer.encoder, network, log);
}

}  // namespace curlew
