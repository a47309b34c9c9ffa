#include "service/detection_training.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <bit>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <map>
#include <memory>
#include <mutex>
#include <numbers>
#include <tuple>

#include "acquisition/random_stream.h"
#include "core/error.h"
#include "detect/vortex_classifier.h"
#include "service/bench_frames.h"
#include "service/classifier_optimiser.h"
#include "service/detection_measurement.h"
#include "service/detection_score.h"
#include "service/parallel.h"
#include "service/spot_camera.h"
#include "service/truth.h"

namespace curlew {
namespace {

using Clock = std::chrono::steady_clock;
double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

std::size_t size(int n) { return static_cast<std::size_t>(n); }

// ---- What a field teaches.

constexpr double kBiasAdu = 100.0;
constexpr double kEPerAdu = 0.25;
constexpr double kReadNoiseE = 1.0;
constexpr double kThresholdE = 3.0;    // of the flux, as the benchmark's centroids have it
constexpr double kIgnoreRadius = 1.0;  // pitches: between kHitRadius and this there is no truth

/// What is to be said of a node and a sign.
struct SignLabel {
  float present = 0;  ///< 1: a required vortex within kHitRadius
  float weight = 1;   ///< 0: neither here nor there
  float dx = 0;
  float dy = 0;
};
using NodeLabel = std::array<SignLabel, 2>;  // charge +1, −1

struct TrainingField {
  FieldParameters parameters;
  Image<float> light;
  Image<NodeLabel> labels;
  Image<std::uint8_t> near_vortex;
};

Image<NodeLabel> label_nodes(const FieldParameters& p, const std::vector<GradedVortex>& truth) {
  Image<NodeLabel> labels(p.rows - 1, p.cols - 1);
  Image<std::array<double, 2>> nearest(p.rows - 1, p.cols - 1, {1e9, 1e9});
  for (const GradedVortex& vortex : truth) {
    const std::size_t sign = vortex.charge > 0 ? 0 : 1;
    const int row = static_cast<int>(std::floor(vortex.y));
    const int col = static_cast<int>(std::floor(vortex.x));
    for (int r = row - 2; r <= row + 2; ++r) {
      for (int c = col - 2; c <= col + 2; ++c) {
        if (!labels.contains(r, c)) continue;
        const double dx = vortex.x - c - 0.5;
        const double dy = vortex.y - r - 0.5;
        const double distance = std::hypot(dx, dy);
        SignLabel& label = labels(r, c)[sign];
        if (distance < kIgnoreRadius && label.present == 0.0F) label.weight = 0.0F;
        if (!vortex.required || distance > kHitRadius || distance > nearest(r, c)[sign]) continue;
        nearest(r, c)[sign] = distance;
        label = {1.0F, 1.0F, static_cast<float>(dx), static_cast<float>(dy)};
      }
    }
  }
  return labels;
}

TrainingField make_training_field(const FieldParameters& p, Realisation realisation) {
  TrainingField field{p, std::move(realisation.light),
                      label_nodes(p, grade_vortices(realisation.vortices)),
                      Image<std::uint8_t>(p.rows - 1, p.cols - 1)};
  for (const SceneVortex& vortex : realisation.vortices) {
    for (int r = 0; r < p.rows - 1; ++r) {
      if (std::abs(r + 0.5 - vortex.y) > 2.0) continue;
      for (int c = 0; c < p.cols - 1; ++c)
        if (std::abs(c + 0.5 - vortex.x) <= 2.0) field.near_vortex(r, c) = 1;
    }
  }
  return field;
}

/// Features of every lenslet of one exposure.
struct Exposure {
  int field = 0;
  Image<float> features;  // [rows, cols·kSpotFeatures]
};

/// Counts and fluxes of a field; photons infinite: each window to the top of the range, and fluxes
/// of no unit.
void expose(const TrainingField& field, double photons, RandomStream& random, FrameBuffer& frame,
            Image<float>& flux_adu) {
  const int window = field.parameters.window_px;
  const bool noisy = std::isfinite(photons);
  auto* counts = reinterpret_cast<std::uint16_t*>(frame.data());
  for (int row = 0; row < flux_adu.rows(); ++row) {
    for (int col = 0; col < flux_adu.cols(); ++col) {
      const auto for_each_pixel = [&](auto&& use) {
        for (int i = row * window; i < (row + 1) * window; ++i)
          for (int j = col * window; j < (col + 1) * window; ++j) use(i, j);
      };
      double flux = 0.0;
      double peak = 0.0;
      for_each_pixel(
          [&](int i, int j) { peak = std::max(peak, static_cast<double>(field.light(i, j))); });
      for_each_pixel([&](int i, int j) {
        const auto light = static_cast<double>(field.light(i, j));
        double adu = peak > 0.0 ? light * 60000.0 / peak : 0.0;
        if (noisy) {
          const double electrons =
              random.poisson(photons * light) + kReadNoiseE * random.gaussian();
          flux += std::max(electrons - kThresholdE, 0.0) / kEPerAdu;
          adu = electrons / kEPerAdu;
        } else {
          flux += light;
        }
        counts[i * field.light.cols() + j] =
            static_cast<std::uint16_t>(std::clamp(std::floor(kBiasAdu + adu + 0.5), 0.0, 65535.0));
      });
      flux_adu(row, col) = static_cast<float>(flux);
    }
  }
}

void measure(const TrainingField& field, double photons, RandomStream& random, Exposure& exposure) {
  const FieldParameters& p = field.parameters;
  FrameFormat format;
  format.rows = p.rows * p.window_px;
  format.cols = p.cols * p.window_px;
  FrameBuffer frame(format);
  Image<float> flux(p.rows, p.cols);
  expose(field, photons, random, frame, flux);
  SpotCamera camera = spot_camera(tiled_sensor({p.rows, p.cols, p.window_px}));
  camera.pixels_per_lambda_w = p.samples_per_lambda_w;
  camera.background_adu = kBiasAdu;
  camera.e_per_adu = std::isfinite(photons) ? kEPerAdu : 0.0;
  camera.read_noise_e = kReadNoiseE;
  const SpotFeatures features(camera, format);
  double mean = 0.0;
  for (const float value : flux) mean += static_cast<double>(value);
  mean /= static_cast<double>(flux.size());
  exposure.features = Image<float>(p.rows, p.cols * kSpotFeatures);
  for (std::size_t k = 0; k < flux.size(); ++k) {
    features.measure(frame.view(), k, flux[k], static_cast<float>(mean),
                     exposure.features.data() + k * kSpotFeatures);
  }
}

// ---- The eight symmetries of the square.

/// (x, y) → (sx·x, sy·y), of the transposed patch if `transpose`.
struct Symmetry {
  Symmetry(bool transpose_first, int sign_x, int sign_y)
      : transpose(transpose_first), sx(sign_x), sy(sign_y) {
    for (int row = 0; row < kPatch; ++row) {
      for (int col = 0; col < kPatch; ++col) {
        const int x = transpose ? row : col;
        const int y = transpose ? col : row;
        const int to_col = sx > 0 ? x : kPatch - 1 - x;
        const int to_row = sy > 0 ? y : kPatch - 1 - y;
        lenslet[size(to_row * kPatch + to_col)] = row * kPatch + col;
      }
    }
    for (int i = 0; i < kSpotFeatures; ++i) {
      feature[size(i)] = i;
      sign[size(i)] = 1.0F;
      if (i >= kSpotModes) continue;
      const SpotMode mode = spot_mode(i);
      if (transpose) feature[size(i)] = spot_mode_index({mode.n, mode.m});
      if ((mode.m % 2 == 1 && sx < 0) != (mode.n % 2 == 1 && sy < 0)) sign[size(i)] = -1.0F;
    }
  }

  bool mirrors() const { return (sx * sy < 0) != transpose; }
  SignLabel operator()(const SignLabel& label) const {
    SignLabel turned = label;
    turned.dx = static_cast<float>(sx) * (transpose ? label.dy : label.dx);
    turned.dy = static_cast<float>(sy) * (transpose ? label.dx : label.dy);
    return turned;
  }

  bool transpose;
  int sx;
  int sy;
  std::array<int, kPatchLenslets> lenslet{};  // of the patch before, by lenslet after
  std::array<int, kSpotFeatures> feature{};
  std::array<float, kSpotFeatures> sign{};
};

std::vector<Symmetry> all_symmetries() {
  std::vector<Symmetry> all;
  for (const bool transpose : {false, true})
    for (const int sx : {1, -1})
      for (const int sy : {1, -1}) all.emplace_back(transpose, sx, sy);
  return all;
}

// ---- Lessons: nodes of fresh exposures, in random order.

class Lessons {
 public:
  Lessons(const std::vector<TrainingField>& fields, std::uint64_t seed)
      : fields_(fields), random_(seed, 1), symmetries_(all_symmetries()) {
    scale_.fill(1.0F);
    expose_anew();
    std::array<double, kSpotFeatures> squares{};
    double n = 0.0;
    for (const Exposure& exposure : exposures_) {
      const Image<float>& features = exposure.features;
      for (std::size_t k = 0; k < features.size(); ++k)
        squares[k % kSpotFeatures] += static_cast<double>(features[k] * features[k]);
      n += static_cast<double>(features.size()) / kSpotFeatures;
    }
    for (int i = 0; i < kSpotFeatures; ++i) {
      double square = squares[size(i)];
      if (i < kSpotModes) {  // transposed modes alike
        const SpotMode mode = spot_mode(i);
        square = std::max(square, squares[size(spot_mode_index({mode.n, mode.m}))]);
      }
      scale_[size(i)] = static_cast<float>(1.0 / std::sqrt(square / n + 1e-12));
    }
  }

  double measuring_s() const { return measuring_s_; }
  const std::array<float, kSpotFeatures>& scale() const { return scale_; }

  /// Fills one node's inputs, [kPatchLenslets, kSpotFeatures], times scale().
  NodeLabel next(float* inputs) {
    if (next_ == nodes_.size()) expose_anew();
    const Node node = nodes_[next_++];
    const Exposure& exposure = exposures_[size(node.exposure)];
    const TrainingField& field = fields_[size(exposure.field)];
    const Symmetry& symmetry = symmetries_[static_cast<std::size_t>(8.0 * random_.uniform())];
    const std::uint32_t missing = draw_missing();
    for (int lenslet = 0; lenslet < kPatchLenslets; ++lenslet, inputs += kSpotFeatures) {
      const int from = symmetry.lenslet[size(lenslet)];
      const int row = node.row - 1 + from / kPatch;
      const int col = node.col - 1 + from % kPatch;
      if (row < 0 || col < 0 || row >= field.parameters.rows || col >= field.parameters.cols ||
          (missing >> lenslet & 1U) != 0) {
        std::fill_n(inputs, kSpotFeatures, 0.0F);
        continue;
      }
      const float* features = &exposure.features(row, col * kSpotFeatures);
      for (std::size_t i = 0; i < kSpotFeatures; ++i)
        inputs[i] = features[symmetry.feature[i]] * symmetry.sign[i] * scale_[i];
    }
    const NodeLabel& label = field.labels(node.row, node.col);
    NodeLabel turned{symmetry(label[0]), symmetry(label[1])};
    if (symmetry.mirrors()) std::swap(turned[0], turned[1]);
    for (SignLabel& sign : turned) sign.weight *= node.weight;
    return turned;
  }

 private:
  static constexpr int kExposures = 24;
  static constexpr double kKeptFar = 0.3;  // of the nodes with no vortex near

  struct Node {
    std::int32_t exposure, row, col;
    float weight;
  };

  /// Now and then the array ends here, or a lenslet is missing.
  std::uint32_t draw_missing() {
    constexpr std::array<std::uint32_t, 4> kSides{0x000FU, 0xF000U, 0x1111U, 0x8888U};
    const double u = random_.uniform();
    if (u < 0.15) return kSides[static_cast<std::size_t>(u / 0.15 * 4.0)];
    if (u < 0.18) {
      const auto first = static_cast<std::size_t>((u - 0.15) / 0.03 * 4.0);
      return kSides[first] | kSides[(first + 2) % 4];
    }
    if (u < 0.25) return 1U << static_cast<unsigned>(random_.uniform() * kPatchLenslets);
    return 0;
  }

  void expose_anew() {
    const Clock::time_point start = Clock::now();
    exposures_.resize(kExposures);
    nodes_.clear();
    for (int i = 0; i < kExposures; ++i) {
      Exposure& exposure = exposures_[size(i)];
      exposure.field = static_cast<int>(random_.uniform() * static_cast<double>(fields_.size()));
      const TrainingField& field = fields_[size(exposure.field)];
      const double kind = random_.uniform();
      const double photons =
          kind < 0.2 ? kWithoutNoise : 130.0 * std::pow(10.0, 1.4 * random_.uniform());
      measure(field, photons, random_, exposure);
      for (int r = 0; r < field.labels.rows(); ++r) {
        for (int c = 0; c < field.labels.cols(); ++c) {
          const bool near = field.near_vortex(r, c) != 0;
          if (near || random_.uniform() < kKeptFar)
            nodes_.push_back({i, r, c, near ? 1.0F : static_cast<float>(1.0 / kKeptFar)});
        }
      }
    }
    for (std::size_t i = nodes_.size(); i > 1; --i) {
      const auto other = static_cast<std::size_t>(random_.uniform() * static_cast<double>(i));
      std::swap(nodes_[i - 1], nodes_[other]);
    }
    next_ = 0;
    measuring_s_ += seconds_since(start);
  }

  const std::vector<TrainingField>& fields_;
  RandomStream random_;
  std::vector<Symmetry> symmetries_;
  std::array<float, kSpotFeatures> scale_{};
  std::vector<Exposure> exposures_;
  std::vector<Node> nodes_;
  std::size_t next_ = 0;
  double measuring_s_ = 0.0;
};

/// Adds a sign's loss, and writes its gradient over the outputs: cross entropy of the presence, and
/// the Gaussian likelihood of the position where a vortex is present.
double lose(const SignLabel& label, const float* output, float scale, float* gradient) {
  constexpr float kPositionWeight = 2.0F;
  const float logit = output[0];
  const float probability = 1.0F / (1.0F + std::exp(-logit));
  gradient[0] = scale * label.weight * (probability - label.present);
  double loss = static_cast<double>(label.weight * (std::log1p(std::exp(-std::abs(logit))) +
                                                    std::max(logit, 0.0F) - label.present * logit));
  std::fill_n(gradient + 1, kNodeOutputs - 1, 0.0F);
  if (label.present == 0.0F) return loss;
  const float log_a = std::clamp(output[3], kLeastLogScale, kMostLogScale);
  const float log_c = std::clamp(output[5], kLeastLogScale, kMostLogScale);
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
  loss += static_cast<double>(label.weight * kPositionWeight *
                              (0.5F * (z1 * z1 + z2 * z2) - log_a - log_c));
  return loss;
}

/// The network for features that are not scaled.
ClassifierNetwork unscaled(ClassifierNetwork network,
                           const std::array<float, kSpotFeatures>& scale) {
  DenseLayer& layer = network.layers.front();
  const auto outputs = size(layer.outputs);
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

// ---- The scout: taught what the trained network finds.

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
  constexpr std::size_t kMostFields = 200;
  constexpr float kFound = 0.1F;
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
    const ClassifierPlan classifier({.min_probability = 0.02, .min_scout = -1e20},
                                    spot_camera(plan.sensor()), plan.format(), network);
    ClassifierWorkspace workspace(classifier);
    VortexList found(field.light.size());
    classify_vortices(classifier, frame.frame.view(), frame.centroids, frame.circulation, workspace,
                      found);
    Image<float> probability(classifier.rows() - 1, classifier.cols() - 1);
    for (const NodeVortex& seen : workspace.seen) {
      float& most = probability(seen.row, seen.col);
      most = std::max(most, seen.vortex.probability);
    }
    for (const std::int32_t node : workspace.nodes) {
      ScoutLesson& lesson = lessons.emplace_back();
      const int row = node / probability.cols();
      const int col = node % probability.cols();
      describe_node(workspace, frame.circulation, row, col, lesson.inputs.data());
      lesson.found = probability(row, col) >= kFound ? 1.0F : 0.0F;
    }
  }
  return lessons;
}

/// Logs what thresholds would cost.
void train_scout(const std::vector<ScoutLesson>& lessons, std::uint64_t seed,
                 ClassifierNetwork& network, const std::function<void(const std::string&)>& log) {
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
      const ClassifierPlan classifier({.min_probability = 0.02, .min_scout = -1e30},
                                      spot_camera(plan->sensor()), plan->format(), network);
      ClassifierWorkspace workspace(classifier);
      MeasuredFrame frame(*plan);
      VortexList found(4096);
      std::vector<FrameVerdicts> verdicts;
      for (std::size_t i = 0; i < fields.realisations.size(); ++i) {
        measure_frame(*plan, fields.realisations[i],
                      realisation_seed(Subset::kValidation, static_cast<int>(i)), frame);
        classify_vortices(classifier, frame.frame.view(), frame.centroids, frame.circulation,
                          workspace, found);
        std::vector<Candidate> candidates;
        for (const Vortex& v : found) {
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

FieldParameters training_field(int index) {
  struct Geometry {
    double lenslet;
    int window_px;
    double samples;
  };
  constexpr std::array<double, 5> kRytov{2.0, 1.0, 4.0, 1.4, 2.8};
  constexpr std::array<Geometry, 10> kGeometries{{{0.064, 6, 2.0},
                                                  {0.045, 8, 2.0},
                                                  {0.064, 6, 2.0},
                                                  {0.09, 4, 2.0},
                                                  {0.064, 6, 2.0},
                                                  {0.032, 6, 2.0},
                                                  {0.064, 6, 2.0},
                                                  {0.14, 12, 3.0},
                                                  {0.064, 6, 2.0},
                                                  {0.064, 9, 3.0}}};
  constexpr double kSide = 3.84;  // √(λL), of what is propagated
  const Geometry& geometry = kGeometries[size(index / 5) % kGeometries.size()];
  FieldParameters p;
  p.rytov_variance = kRytov[size(index) % kRytov.size()];
  p.lenslet = geometry.lenslet;
  p.window_px = geometry.window_px;
  p.samples_per_lambda_w = geometry.samples;
  p.rows = p.cols = std::min(60, static_cast<int>(kSide / geometry.lenslet));
  return p;
}

TrainingReport train_vortex_classifier(const TrainingOptions& options,
                                       const RealisationCache& cache,
                                       const std::function<void(const std::string&)>& log) {
  if (options.fields < 1 || options.validation_fields < 1 || options.steps < 1 || options.batch < 1)
    throw UsageError("training needs fields, validation fields, steps and a batch of 1 or more");
  TrainingReport report;
  Clock::time_point start = Clock::now();
  std::vector<TrainingField> fields(size(options.fields));
  std::mutex logging;
  int done = 0;
  for_each_in_parallel(options.fields, options.threads, [&](int i, int) {
    const FieldParameters p = training_field(i);
    fields[size(i)] =
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
  std::vector<NodeLabel> labels(size(options.batch));
  constexpr int kTrials = 8;
  double loss = 0.0;
  int losses = 0;
  double best = -1.0;
  const auto outputs = size(ClassifierNetwork::kOutputs[ClassifierNetwork::kHeadEnd - 1]);
  for (int step = 1; step <= options.steps; ++step) {
    for (std::size_t i = 0; i < labels.size(); ++i)
      labels[i] = lessons.next(optimiser.inputs() + i * kPatchLenslets * kSpotFeatures);
    const float* output = optimiser.run();
    float* gradient = optimiser.output_gradient();
    std::fill_n(gradient, labels.size() * outputs, 0.0F);
    const float scale = 1.0F / static_cast<float>(options.batch);
    for (std::size_t i = 0; i < labels.size(); ++i, output += outputs, gradient += outputs)
      for (std::size_t sign = 0; sign < 2; ++sign)
        loss += lose(labels[i][sign], output + sign * kNodeOutputs, scale,
                     gradient + sign * kNodeOutputs);
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
  train_scout(scout_lessons(fields, report.network), options.seed, report.network, log);
  report.scouting_s = seconds_since(scouting);
  report.measuring_s = lessons.measuring_s();
  report.training_s =
      seconds_since(start) - report.scouting_s - report.measuring_s - report.validating_s;
  return report;
}

std::string weights_text(const TrainingReport& report, const std::string& command) {
  std::string text = fmt::format(
      "// Weights of the vortex classifier, version 1. Made, not written, by\n//   {}\n"
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
