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
#include <optional>
#include <tuple>
#include <utility>

#include "acquisition/simulator/random_stream.h"
#include "core/as_size.h"
#include "core/error.h"
#include "detect/classifier/vortex_classifier.h"
#include "service/bench/detection_measurement.h"
#include "service/bench/detection_score.h"
#include "service/program/parallel.h"
#include "service/spot_camera.h"
#include "service/training/classifier_optimiser.h"
#include "service/training/network_symmetry.h"
#include "service/training/scout_training.h"
#include "service/training/training_fields.h"
#include "service/training/training_lessons.h"

namespace curlew {
namespace {

using Clock = std::chrono::steady_clock;
double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

/// Returns the cross entropy of a presence and writes its gradient.
double lose_presence(const Label& label, float logit, float scale, float& gradient) {
  const float probability = 1.0F / (1.0F + std::exp(-logit));
  gradient = scale * label.weight * (probability - label.present);
  return static_cast<double>(label.weight * (std::log1p(std::exp(-std::abs(logit))) +
                                             std::max(logit, 0.0F) - label.present * logit));
}

/// Returns the loss of one sign of charge and writes its gradient. The loss is that of the presence
/// and, where there is a vortex, the negative logarithm of its position's Gaussian likelihood.
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

/// Returns the loss of an unresolved pair and writes its gradient, in the same way.
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

/// Sums all losses of a node and writes their gradient.
double lose(const NodeLabel& label, const float* output, float scale, float* gradient) {
  return lose_vortex(label[0], output, scale, gradient) +
         lose_vortex(label[1], output + kNodeOutputs, scale, gradient + kNodeOutputs) +
         lose_pair(label[2], output + kFirstPairOutput, scale, gradient + kFirstPairOutput);
}

/// Returns the network in which the judge in question takes features as they are, from one in which
/// it takes them times `scale`.
ClassifierNetwork scaled(ClassifierNetwork network, const JudgeLayers& judge,
                         const std::array<float, kSpotFeatures>& scale) {
  DenseLayer& layer = network.layers[as_size(judge.encoder)];
  const auto outputs = as_size(layer.outputs);
  for (std::size_t k = 0; k < std::size_t{kTraitBlocks} * kSpotFeatures * outputs; ++k)
    layer.weights[k] *= scale[k / outputs % kSpotFeatures];
  return network;
}

void initialise(ClassifierNetwork& network, int first, int end, RandomStream& random) {
  for (int i = first; i < end; ++i) {
    DenseLayer& layer = network.layers[as_size(i)];
    const bool last = !ClassifierNetwork::rectified(i);
    const double deviation = last ? 0.1 / std::sqrt(layer.inputs) : std::sqrt(2.0 / layer.inputs);
    for (float& weight : layer.weights) weight = static_cast<float>(deviation * random.gaussian());
    std::fill(layer.bias.begin(), layer.bias.end(), 0.0F);
  }
}

// Networks are validated in the benchmark's turbulence and noise, on larger arrays than its own.

struct ValidationFields {
  double rytov_variance;
  std::vector<Realisation> realisations;
  std::vector<std::vector<GradedVortex>> truths;
  std::vector<std::unique_ptr<MeasurementPlan>> plans;  ///< one for each flux
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
        find_classified_vortices(classifier, frame.frame.view(), frame.shift(), frame.centroids,
                                 frame.circulation, workspace, found);
        verdicts.push_back(judge_frame(candidates_by_probability(found), fields.truths[i],
                                       {plan->parameters().rows, plan->parameters().cols}));
      }
      const DetectionRecord record(verdicts);
      const DetectionScore score = record.score(record.best_threshold());
      const MeasurementOptions& seen = plan->options();
      scores.push_back({fields.rytov_variance, seen.photons, seen.blur, seen.faded,
                        score.average_precision, score.f1, score.rms});
    }
  }
  return scores;
}

/// Returns the mean over the cells that have a required vortex; the others have no average
/// precision.
double mean_precision(const std::vector<ValidationScore>& scores) {
  double sum = 0.0;
  int n = 0;
  for (const ValidationScore& score : scores) {
    if (std::isnan(score.average_precision)) continue;
    sum += score.average_precision;
    ++n;
  }
  if (n == 0)
    throw UsageError(
        "the validation fields hold no vortex that must be found, so that nothing tells which "
        "network is the best; take more or larger validation fields");
  return sum / n;
}

void check_options(const TrainingOptions& options) {
  if (options.fields < 1 || options.validation_fields < 1 || options.steps < 1 || options.batch < 1)
    throw UsageError("training needs fields, validation fields, steps and a batch of 1 or more");
}

std::vector<TrainingField> make_training_fields(
    const TrainingOptions& options, const RealisationCache& cache,
    const std::function<void(const std::string&)>& log) {
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
  return fields;
}

std::vector<ValidationFields> make_validation_fields(const TrainingOptions& options,
                                                     const RealisationCache& cache) {
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
    for (const auto& [photons, blur, faded] : {std::tuple{kWithoutNoise, 0.0, 0.0},
                                               {1000.0, 0.0, 0.0},
                                               {200.0, 0.0, 0.0},
                                               {1000.0, 0.3, 0.0},
                                               {1000.0, 0.0, 0.05}}) {
      MeasurementOptions measurement;
      measurement.photons = photons;
      measurement.blur = blur;
      measurement.faded = faded;
      of_variance.plans.push_back(std::make_unique<MeasurementPlan>(p, measurement));
    }
  }
  return validation;
}

std::string score_text(const std::vector<ValidationScore>& scores) {
  std::string text = "validation AP";
  for (const ValidationScore& score : scores)
    text += fmt::format(" {:.3f}", score.average_precision);
  text += ", F1";
  for (const ValidationScore& score : scores) text += fmt::format(" {:.3f}", score.f1);
  text += ", rms";
  for (const ValidationScore& score : scores) text += fmt::format(" {:.3f}", score.rms);
  return text;
}

/// Trains scout and screen of a network whose judges are trained.
void train_gates(const std::vector<TrainingField>& fields, std::uint64_t seed,
                 ClassifierNetwork& network, const std::function<void(const std::string&)>& log) {
  constexpr float kScoutRaise = 1.0F;  // of the logit
  train_scout(fields, seed, network, log);
  train_screen(fields, seed, network, log);
  // The scout's least logit of −2 would be too strict: 2 % of the nodes with a vortex have less
  // than −3.4. It is raised last, because the screen learns on the nodes that the scout lets pass.
  network.layers[ClassifierNetwork::kScreen - 1].bias.front() += kScoutRaise;
}

/// Makes a judge symmetrical. `kept` scales the weights.
void make_symmetrical(const NetworkSymmetry& symmetry, const JudgeLayers& judge, float kept,
                      ClassifierNetwork& network) {
  for (int i = judge.encoder; i < judge.end; ++i) {
    DenseLayer& layer = network.layers[as_size(i)];
    symmetry.symmetrise(as_size(i - judge.encoder), layer.weights, layer.bias);
    for (float& weight : layer.weights) weight *= kept;
  }
}

/// Trains the judge or the reviewer, and keeps the network that does best in validation. The
/// reviewer is kept symmetrical.
class JudgeTraining {
 public:
  JudgeTraining(const TrainingOptions& options, const std::vector<TrainingField>& fields,
                const std::vector<ValidationFields>& validation,
                const std::function<void(const std::string&)>& log)
      : options_(options),
        judge_(options.reviewer ? ClassifierNetwork::kReviewer : ClassifierNetwork::kJudge),
        validation_(validation),
        log_(log),
        lessons_(fields, options.seed),
        network_(initial_network()),
        optimiser_(network_, judge_.encoder, judge_.end, options.batch),
        labels_(as_size(options.batch)) {}

  double seconds() const { return seconds_since(start_); }
  double measuring_s() const { return lessons_.measuring_s(); }

  void run(TrainingReport& report) {
    constexpr int kTrials = 8;
    const int steps_per_trial = std::max(options_.steps / kTrials, 1);
    for (int step = 1; step <= options_.steps; ++step) {
      learn(step);
      if (step % steps_per_trial == 0 || step == options_.steps) try_out(step, report);
    }
  }

 private:
  ClassifierNetwork initial_network() {
    ClassifierNetwork network = shipped_classifier_network();
    if (options_.reviewer) symmetry_.emplace(judge_);
    if (options_.from_shipped) {
      std::array<float, kSpotFeatures> scale = lessons_.scale();
      for (float& factor : scale) factor = 1.0F / factor;
      network = scaled(std::move(network), judge_, scale);
      if (symmetry_) make_symmetrical(*symmetry_, judge_, 1.0F, network);
      return network;
    }
    RandomStream random(options_.seed, 0);
    if (options_.reviewer) {
      initialise(network, judge_.encoder, judge_.end, random);
      // The mean of eight random numbers is as much smaller.
      make_symmetrical(*symmetry_, judge_, std::sqrt(8.0F), network);
    } else {
      initialise(network, 0, ClassifierNetwork::kReviewer.encoder, random);
    }
    return network;
  }

  /// Learns one batch of nodes.
  void learn(int step) {
    constexpr std::size_t kOutputs = kFirstPairOutput + kPairOutputs;
    for (std::size_t i = 0; i < labels_.size(); ++i)
      labels_[i] = lessons_.next(optimiser_.inputs() + i * kPatchLenslets * kTaughtInputs);
    const float* output = optimiser_.run();
    float* gradient = optimiser_.output_gradient();
    std::fill_n(gradient, labels_.size() * kOutputs, 0.0F);
    const float scale = 1.0F / static_cast<float>(options_.batch);
    for (const NodeLabel& label : labels_) {
      loss_ += lose(label, output, scale, gradient);
      output += kOutputs;
      gradient += kOutputs;
    }
    losses_ += options_.batch;
    optimiser_.step(learning_rate(step), symmetry_ ? &*symmetry_ : nullptr);
  }

  /// Returns the learning rate, which rises during the warm-up and then falls along a cosine.
  double learning_rate(int step) const {
    constexpr int kWarmUp = 200;
    const double progress = static_cast<double>(step) / options_.steps;
    const double annealed = 0.5 * (1.0 + std::cos(std::numbers::pi * progress)) + 0.003;
    return options_.learning_rate * std::min(1.0, 1.0 * step / kWarmUp) * annealed;
  }

  /// Validates the network as it is now, and keeps it if it is the best so far.
  void try_out(int step, TrainingReport& report) {
    const Clock::time_point validating = Clock::now();
    const ClassifierNetwork trial = scaled(network_, judge_, lessons_.scale());
    const std::vector<ValidationScore> scores = validate(validation_, trial);
    report.validating_s += seconds_since(validating);
    log_(fmt::format("step {} of {}, {:.0f} s, loss {:.4f}, {}", step, options_.steps, seconds(),
                     loss_ / losses_, score_text(scores)));
    loss_ = 0.0;
    losses_ = 0;
    if (mean_precision(scores) > best_) {
      best_ = mean_precision(scores);
      report.network = trial;
      report.validation = scores;
    }
  }

  const TrainingOptions& options_;
  const JudgeLayers judge_;
  const std::vector<ValidationFields>& validation_;
  const std::function<void(const std::string&)>& log_;
  Clock::time_point start_ = Clock::now();
  Lessons lessons_;
  std::optional<NetworkSymmetry> symmetry_;
  ClassifierNetwork network_;
  ClassifierOptimiser optimiser_;
  std::vector<NodeLabel> labels_;
  double loss_ = 0.0;  ///< sum over the nodes since the last trial
  int losses_ = 0;     ///< number of nodes in the sum
  double best_ = -1.0;
};

}  // namespace

std::string ValidationScore::text() const {
  std::string condition =
      std::isfinite(photons) ? fmt::format("{}", photons) : std::string("no noise");
  if (blur > 0.0) condition += fmt::format(", blur {}", blur);
  if (faded > 0.0) condition += fmt::format(", {} faded", faded);
  return fmt::format("{}, {}: {:.3f}, {:.3f}, {:.3f}", rytov_variance, condition, average_precision,
                     f1, rms);
}

TrainingReport train_vortex_classifier(const TrainingOptions& options,
                                       const RealisationCache& cache,
                                       const std::function<void(const std::string&)>& log) {
  check_options(options);
  TrainingReport report;
  const Clock::time_point simulating = Clock::now();
  std::vector<TrainingField> fields = make_training_fields(options, cache, log);
  const std::vector<ValidationFields> validation = make_validation_fields(options, cache);
  report.simulating_s = seconds_since(simulating);

  JudgeTraining training(options, fields, validation, log);
  training.run(report);
  const Clock::time_point scouting = Clock::now();
  if (!options.reviewer) train_gates(fields, options.seed, report.network, log);
  report.scouting_s = seconds_since(scouting);
  report.measuring_s = training.measuring_s();
  report.training_s =
      training.seconds() - report.scouting_s - report.measuring_s - report.validating_s;
  return report;
}

std::string weights_text(const TrainingReport& report, const TrainingOptions& options,
                         const std::string& command) {
  std::string text = fmt::format(
      "// Weights of the vortex classifier's {}. Made, not written, by\n//   {}\n"
      "// --from-shipped begins with the weights that stood here before.\n"
      "// Validation of judge and reviewer together (Rytov variance, photons: average precision, "
      "F1, "
      "rms in pitches):\n",
      options.reviewer ? "reviewer" : "judge, scout and screen, version 4", command);
  for (const ValidationScore& score : report.validation)
    text += fmt::format("//   {}\n", score.text());
  constexpr int kReviewer = ClassifierNetwork::kReviewer.encoder;
  const int first = options.reviewer ? kReviewer : 0;
  const int end = options.reviewer ? ClassifierNetwork::kLayers : kReviewer;
  int column = 0;
  for (int i = first; i < end; ++i) {
    const DenseLayer& layer = report.network.layers[as_size(i)];
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
