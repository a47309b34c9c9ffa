#include "service/training/detection_training.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <memory>
#include <mutex>
#include <numbers>

#include "acquisition/simulator/random_stream.h"
#include "core/as_size.h"
#include "core/error.h"
#include "detect/classifier/vortex_classifier.h"
#include "service/bench/detection_measurement.h"
#include "service/bench/detection_score.h"
#include "service/program/parallel.h"
#include "service/spot_camera.h"
#include "service/training/classifier_optimiser.h"
#include "service/training/scout_training.h"
#include "service/training/training_fields.h"
#include "service/training/training_lessons.h"

namespace curlew {
namespace {

using Clock = std::chrono::steady_clock;
double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

/// The cross entropy of a presence; adds its gradient.
double lose_presence(const Label& label, float logit, float scale, float& gradient) {
  const float probability = 1.0F / (1.0F + std::exp(-logit));
  gradient = scale * label.weight * (probability - label.present);
  return static_cast<double>(label.weight * (std::log1p(std::exp(-std::abs(logit))) +
                                             std::max(logit, 0.0F) - label.present * logit));
}

/// The loss of a sign, its gradient written over the outputs: of its presence and, where a vortex
/// is, the Gaussian likelihood of its position.
double lose_vortex(const Label& label, const float* output, float scale, float* gradient) {
  constexpr float kPositionWeight = 2.0F;
  const double loss = lose_presence(label, output[0], scale, gradient[0]);
  if (label.present == 0.0F) return loss;
  const float log_a = std::clamp(output[3], kMinLogScale, kMaxLogScale);
  const float log_c = std::clamp(output[5], kMinLogScale, kMaxLogScale);
  const float a = std::exp(log_a);
  const float b = output[4];
  const float c = std::exp(log_c);
  const float ex = output[1] - label.dx;
  const float ey = output[2] - label.dy;
  const float z1 = a * ex;
  const float z2 = b * ex + c * ey;
  const float weight = scale * label.weight * kPositionWeight;
  gradient[1] = weight * (a * z1 + b * z2);
  gradient[2] = weight * c * z2;
  gradient[3] = weight * (z1 * z1 - 1.0F);
  gradient[4] = weight * z2 * ex;
  gradient[5] = weight * (c * z2 * ey - 1.0F);
  return loss + static_cast<double>(label.weight * kPositionWeight *
                                    (0.5F * (z1 * z1 + z2 * z2) - log_a - log_c));
}

/// The same of an unresolved pair.
double lose_pair(const Label& label, const float* output, float scale, float* gradient) {
  constexpr float kPairWeight = 0.3F;
  constexpr float kPositionWeight = 0.5F;
  scale *= kPairWeight;
  const double loss =
      static_cast<double>(kPairWeight) * lose_presence(label, output[0], scale, gradient[0]);
  if (label.present == 0.0F) return loss;
  const float log_scale = std::clamp(output[3], kMinLogScale, kMaxLogScale);
  const float square = std::exp(2.0F * log_scale);
  const float ex = output[1] - label.dx;
  const float ey = output[2] - label.dy;
  const float chi_square = square * (ex * ex + ey * ey);
  const float weight = scale * label.weight * kPositionWeight;
  gradient[1] = weight * square * ex;
  gradient[2] = weight * square * ey;
  gradient[3] = weight * (chi_square - 2.0F);
  return loss + static_cast<double>(kPairWeight * label.weight * kPositionWeight *
                                    (0.5F * chi_square - 2.0F * log_scale));
}

/// All of a node's losses.
double lose(const NodeLabel& label, const float* output, float scale, float* gradient) {
  return lose_vortex(label[0], output, scale, gradient) +
         lose_vortex(label[1], output + kNodeOutputs, scale, gradient + kNodeOutputs) +
         lose_pair(label[2], output + kFirstPairOutput, scale, gradient + kFirstPairOutput);
}

/// The network for features that are not scaled.
ClassifierNetwork unscaled(ClassifierNetwork network,
                           const std::array<float, kSpotFeatures>& scale) {
  DenseLayer& layer = network.layers.front();
  const auto outputs = as_size(layer.outputs);
  for (std::size_t k = 0; k < layer.weights.size(); ++k) layer.weights[k] *= scale[k / outputs];
  return network;
}

void initialise(ClassifierNetwork& network, RandomStream& random) {
  for (DenseLayer& layer : network.layers) {
    const bool last =
        !ClassifierNetwork::rectified(static_cast<int>(&layer - &network.layers.front()));
    const double deviation = last ? 0.1 / std::sqrt(layer.inputs) : std::sqrt(2.0 / layer.inputs);
    for (float& weight : layer.weights) weight = static_cast<float>(deviation * random.gaussian());
    std::fill(layer.bias.begin(), layer.bias.end(), 0.0F);
  }
}

// ---- Validation: the benchmark's turbulence and noise on larger arrays.

struct ValidationFields {
  double rytov_variance;
  std::vector<Realisation> realisations;
  std::vector<std::vector<GradedVortex>> truths;
  std::vector<std::unique_ptr<MeasurementPlan>> plans;  // by flux
};

FieldParameters validation_parameters(double rytov_variance, int lenslets) {
  FieldParameters p;
  p.rytov_variance = rytov_variance;
  p.rows = p.cols = lenslets;
  return p;
}

std::vector<ValidationScore> validate(const std::vector<ValidationFields>& all,
                                      const ClassifierNetwork& network) {
  std::vector<ValidationScore> scores;
  for (const ValidationFields& fields : all) {
    for (const auto& plan : fields.plans) {
      const ClassifierPlan classifier(
          {.min_probability = 0.02, .min_scout = -1e30, .as_trained = true},
          spot_camera(plan->sensor()), plan->format(), network);
      ClassifierWorkspace workspace(classifier);
      MeasuredFrame frame(*plan);
      VortexList found(4096);
      std::vector<FrameVerdicts> verdicts;
      for (std::size_t i = 0; i < fields.realisations.size(); ++i) {
        measure_frame(*plan, fields.realisations[i],
                      realisation_seed(Subset::kValidation, static_cast<int>(i)), frame);
        find_classified_vortices(classifier, frame.frame.view(), frame.centroids, frame.circulation,
                                 workspace, found);
        std::vector<Candidate> candidates;
        for (const Vortex& v : found) {
          if (v.charge == 0) continue;
          candidates.push_back({static_cast<double>(v.x), static_cast<double>(v.y), v.charge,
                                static_cast<double>(v.probability)});
        }
        verdicts.push_back(judge_frame(candidates, fields.truths[i],
                                       {plan->parameters().rows, plan->parameters().cols}));
      }
      const DetectionRecord record(verdicts);
      const DetectionScore score = record.score(record.best_threshold());
      scores.push_back({fields.rytov_variance, plan->options().photons, score.average_precision,
                        score.f1, score.rms});
    }
  }
  return scores;
}

double mean_precision(const std::vector<ValidationScore>& scores) {
  double sum = 0.0;
  for (const ValidationScore& score : scores) sum += score.average_precision;
  return sum / static_cast<double>(scores.size());
}

}  // namespace

TrainingReport train_vortex_classifier(const TrainingOptions& options,
                                       const RealisationCache& cache,
                                       const std::function<void(const std::string&)>& log) {
  if (options.fields < 1 || options.validation_fields < 1 || options.steps < 1 || options.batch < 1)
    throw UsageError("training needs fields, validation fields, steps and a batch of 1 or more");
  TrainingReport report;
  Clock::time_point start = Clock::now();
  std::vector<TrainingField> fields(as_size(options.fields));
  std::mutex logging;
  int done = 0;
  for_each_in_parallel(options.fields, options.threads, [&](int i, int) {
    const FieldParameters p = training_field(i);
    fields[as_size(i)] =
        make_training_field(p, cache.read_or_simulate(p, realisation_seed(Subset::kTraining, i)));
    const std::scoped_lock lock(logging);
    if (++done % 50 == 0) log(fmt::format("{} of {} fields", done, options.fields));
  });
  std::vector<ValidationFields> validation;
  for (const double rytov_variance : {1.0, 2.0, 4.0}) {
    const FieldParameters p = validation_parameters(rytov_variance, options.validation_lenslets);
    ValidationFields& of_variance = validation.emplace_back();
    of_variance.rytov_variance = rytov_variance;
    for (int i = 0; i < options.validation_fields; ++i) {
      of_variance.realisations.push_back(
          cache.read_or_simulate(p, realisation_seed(Subset::kValidation, i)));
      of_variance.truths.push_back(grade_vortices(of_variance.realisations.back().vortices));
    }
    for (const double photons : {kWithoutNoise, 1000.0, 200.0}) {
      MeasurementOptions measurement;
      measurement.photons = photons;
      of_variance.plans.push_back(std::make_unique<MeasurementPlan>(p, measurement));
    }
  }
  report.simulating_s = seconds_since(start);

  start = Clock::now();
  ClassifierNetwork network;
  RandomStream random(options.seed, 0);
  initialise(network, random);
  Lessons lessons(fields, options.seed);
  ClassifierOptimiser optimiser(network, 0, ClassifierNetwork::kHeadEnd, options.batch);
  std::vector<NodeLabel> labels(as_size(options.batch));
  constexpr int kTrials = 8;
  double loss = 0.0;
  int losses = 0;
  double best = -1.0;
  const auto outputs = as_size(ClassifierNetwork::kOutputs[ClassifierNetwork::kHeadEnd - 1]);
  for (int step = 1; step <= options.steps; ++step) {
    for (std::size_t i = 0; i < labels.size(); ++i)
      labels[i] = lessons.next(optimiser.inputs() + i * kPatchLenslets * kSpotFeatures);
    const float* output = optimiser.run();
    float* gradient = optimiser.output_gradient();
    std::fill_n(gradient, labels.size() * outputs, 0.0F);
    const float scale = 1.0F / static_cast<float>(options.batch);
    for (std::size_t i = 0; i < labels.size(); ++i, output += outputs, gradient += outputs)
      loss += lose(labels[i], output, scale, gradient);
    losses += options.batch;
    constexpr int kWarmUp = 200;
    const double progress = static_cast<double>(step) / options.steps;
    const double annealed = 0.5 * (1.0 + std::cos(std::numbers::pi * progress)) + 0.003;
    optimiser.step(options.learning_rate * std::min(1.0, 1.0 * step / kWarmUp) * annealed);

    if (step % std::max(options.steps / kTrials, 1) != 0 && step != options.steps) continue;
    const Clock::time_point validating = Clock::now();
    const ClassifierNetwork trial = unscaled(network, lessons.scale());
    const std::vector<ValidationScore> scores = validate(validation, trial);
    report.validating_s += seconds_since(validating);
    std::string text = fmt::format("step {} of {}, {:.0f} s, loss {:.4f}, validation AP", step,
                                   options.steps, seconds_since(start), loss / losses);
    for (const ValidationScore& score : scores)
      text += fmt::format(" {:.3f}", score.average_precision);
    text += ", F1";
    for (const ValidationScore& score : scores) text += fmt::format(" {:.3f}", score.f1);
    text += ", rms";
    for (const ValidationScore& score : scores) text += fmt::format(" {:.3f}", score.rms);
    log(text);
    loss = 0.0;
    losses = 0;
    if (mean_precision(scores) > best) {
      best = mean_precision(scores);
      report.network = trial;
      report.validation = scores;
    }
  }
  const Clock::time_point scouting = Clock::now();
  train_scout(fields, options.seed, report.network, log);
  train_screen(fields, options.seed, report.network, log);
  report.scouting_s = seconds_since(scouting);
  report.measuring_s = lessons.measuring_s();
  report.training_s =
      seconds_since(start) - report.scouting_s - report.measuring_s - report.validating_s;
  return report;
}

std::string weights_text(const TrainingReport& report, const std::string& command) {
  std::string text = fmt::format(
      "// Weights of the vortex classifier, version 2. Made, not written, by\n//   {}\n"
      "// Validation (Rytov variance, photons: average precision, F1, rms in pitches):\n",
      command);
  for (const ValidationScore& score : report.validation) {
    text +=
        fmt::format("//   {}, {}: {:.3f}, {:.3f}, {:.3f}\n", score.rytov_variance,
                    std::isfinite(score.photons) ? fmt::format("{}", score.photons) : "no noise",
                    score.average_precision, score.f1, score.rms);
  }
  int column = 0;
  for (const DenseLayer& layer : report.network.layers) {
    for (const AlignedVector<float>* part : {&layer.weights, &layer.bias}) {
      for (const float value : *part) {
        text += fmt::format("{:.4e}F,", static_cast<double>(value));
        text += ++column % 8 == 0 ? "\n" : "";
      }
    }
  }
  return text + "\n";
}

}  // namespace curlew
