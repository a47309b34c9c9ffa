#include "service/bench/phase_benchmark.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <mutex>
#include <numbers>
#include <utility>

#include "detect/circulation_finder.h"
#include "detect/classifier/vortex_classifier.h"
#include "reconstruct/hidden_phase.h"
#include "service/bench/phase_exponential.h"
#include "service/bench/phase_strehl.h"
#include "service/program/parallel.h"
#include "service/spot_camera.h"

namespace curlew {
namespace {

constexpr std::size_t kMaxVortices = 128;
/// The part of a slope's variance that noise does not explain is this times (1 + mean flux / flux
/// of the lenslet), in rad² per pitch². Dark lenslets measure their own gradient badly.
constexpr float kModelVariance = 0.02F;

struct Row {
  const char* name;
  const char* method;
};
enum RowIndex : std::uint8_t {
  kNone,
  kEqual,
  kWeighted,
  kHidden,
  kHiddenEqual,
  kProbable,
  kCirculation,
  kCirculationChosen,
  kExponential,
  kTrue,
  kRows,
};
constexpr std::array<Row, kRows> kRowNames = {{
    {"uncorrected", "nothing is taken off"},
    {"ls", "least squares, equal weights"},
    {"ls_weighted", "least squares, weights 1/(noise + .02 (1 + mean flux / flux))"},
    {"hidden", "ls_weighted + hidden phase of the classifier's candidates that the slopes choose"},
    {"hidden_equal", "the same on ls"},
    {"hidden_probable", "ls_weighted + hidden phase of the classifier's vortices with p >= 1/2"},
    {"circulation", "ls_weighted + hidden phase of find_circulation_vortices (|D| over its sigma)"},
    {"circulation_chosen", "the same, of those that the slopes choose"},
    {"exponential", "ls_weighted + hidden phase of a phasor fit's zeros (after Fried 2001)"},
    {"hidden_true", "ls_weighted + hidden phase of the true vortices: the bound"},
}};

SplitOptions weighted_split() {
  SplitOptions options;
  options.weighted = true;
  options.tolerance = 1e-3;
  return options;
}

HiddenPhaseOptions hidden_options(bool choose) {
  HiddenPhaseOptions options;
  options.choose = choose;
  return options;
}

/// What the rows share in one cell. It is const, for all threads.
struct CellPlan {
  CellPlan(const FieldParameters& field, const MeasurementOptions& options)
      : measurement(field, options),
        classifier({.min_probability = hidden_options(true).choice.min_probability},
                   spot_camera(measurement.sensor()), measurement.format()),
        circulation({}, measurement.sensor().valid, kMaxVortices),
        split(measurement.sensor().valid, weighted_split()),
        choosing(split, hidden_options(true), kMaxVortices),
        choosing_equal(measurement.split(), hidden_options(true), kMaxVortices),
        believing(split, hidden_options(false), kMaxVortices) {}

  MeasurementPlan measurement;
  ClassifierPlan classifier;
  CirculationPlan circulation;
  SplitPlan split;
  HiddenPhasePlan choosing;
  HiddenPhasePlan choosing_equal;
  HiddenPhasePlan believing;
};

/// The frame and the estimates of one thread.
class Estimator {
 public:
  explicit Estimator(const CellPlan& plan)
      : plan_(plan),
        frame_(plan.measurement),
        slopes_(frame_.slopes),
        split_workspace_(plan.split),
        split_(slopes_.rows(), slopes_.cols()),
        classifier_workspace_(plan.classifier),
        vortices_(kMaxVortices),
        choosing_(plan.choosing),
        choosing_equal_(plan.choosing_equal),
        believing_(plan.believing),
        whole_(slopes_.rows(), slopes_.cols()) {}

  void measure(const Realisation& realisation, std::uint64_t seed) {
    measure_frame(plan_.measurement, realisation, seed, frame_);
    slopes_ = frame_.slopes;
    const Image<float>& flux = frame_.centroids.flux_adu;
    const FieldParameters& field = plan_.measurement.parameters();
    const auto window_rad =
        static_cast<float>(2.0 * std::numbers::pi * field.window_px / field.samples_per_lambda_w);
    // A spot of one pixel has no width, and therefore a variance of 0 that means nothing. It gets
    // the variance of a spot that may be anywhere in its window.
    const float unknown = plan_.measurement.noisy() ? window_rad * window_rad / 12.0F : 0.0F;
    float mean = 0.0F;
    for (const float f : flux) mean += f / static_cast<float>(flux.size());
    for (std::size_t k = 0; k < flux.size(); ++k) {
      const float model = kModelVariance * (1.0F + mean / std::max(flux[k], 1e-3F * mean));
      for (float* variance : {&slopes_.variance_x[k], &slopes_.variance_y[k]})
        *variance = (*variance > 0.0F && std::isfinite(*variance) ? *variance : unknown) + model;
    }
    split_slopes(plan_.split, slopes_, split_workspace_, split_);
  }

  PhaseEstimate estimate(int row, const Realisation& realisation) {
    switch (row) {
      case kEqual:
        return {frame_.split.phase, {}, {}};
      case kWeighted:
        return {split_.phase, {}, {}};
      case kHidden:
        classify();
        return with_hidden(plan_.choosing, choosing_, slopes_, split_, split_workspace_);
      case kHiddenEqual:
        classify();
        return with_hidden(plan_.choosing_equal, choosing_equal_, frame_.slopes, frame_.split,
                           frame_.split_workspace);
      case kProbable:
        classify();
        return with_hidden(plan_.believing, believing_, slopes_, split_, split_workspace_);
      case kCirculation:
        circulate();
        return with_hidden(plan_.believing, believing_, slopes_, split_, split_workspace_);
      case kCirculationChosen:
        circulate();
        return with_hidden(plan_.choosing, choosing_, slopes_, split_, split_workspace_);
      case kExponential:
        vortices_.clear();
        for (const PointVortex& v : vortices_of_exponential(slopes_, frame_.centroids.flux_adu))
          add(v.x, v.y, v.charge > 0.0F ? 1 : -1);
        return with_hidden(plan_.believing, believing_, slopes_, split_, split_workspace_);
      default:
        vortices_.clear();
        for (const SceneVortex& v : realisation.vortices)
          if (on_array(v)) add(static_cast<float>(v.x), static_cast<float>(v.y), v.charge);
        return with_hidden(plan_.believing, believing_, slopes_, split_, split_workspace_);
    }
  }

  bool on_array(const SceneVortex& v) const {
    return v.x > -0.5 && v.x < slopes_.cols() - 0.5 && v.y > -0.5 && v.y < slopes_.rows() - 0.5;
  }

 private:
  void classify() {
    find_classified_vortices(plan_.classifier, frame_.frame.view(), frame_.shift(),
                             frame_.centroids, frame_.circulation, classifier_workspace_,
                             vortices_);
  }
  /// Finds vortices of the circulation, on the lenslets that have light only.
  void circulate() {
    SlopeField lit = frame_.slopes;
    for (std::size_t k = 0; k < lit.valid.size(); ++k)
      lit.valid[k] = frame_.centroids.state[k] == LensletState::kValid ? 1 : 0;
    CirculationMap map(lit.rows(), lit.cols());
    curlew::circulate(lit, map);
    find_circulation_vortices(plan_.circulation, map, vortices_);
  }
  void add(float x, float y, int charge) {
    Vortex vortex;
    vortex.x = x;
    vortex.y = y;
    vortex.charge = charge;
    vortices_.push(vortex);
  }

  PhaseEstimate with_hidden(const HiddenPhasePlan& plan, HiddenPhaseWorkspace& workspace,
                            const SlopeField& slopes, const HodgeSplit& split,
                            SplitWorkspace& split_workspace) {
    add_hidden_phase(plan, vortices_, slopes, frame_.centroids.flux_adu, split, split_workspace,
                     workspace, whole_);
    PhaseEstimate estimate{workspace.smooth, workspace.rotational, {}};
    for (const PointVortex& vortex : workspace.points) estimate.vortices.push_back(vortex);
    return estimate;
  }

  const CellPlan& plan_;
  MeasuredFrame frame_;
  SlopeField slopes_;
  SplitWorkspace split_workspace_;
  HodgeSplit split_;
  ClassifierWorkspace classifier_workspace_;
  VortexList vortices_;
  HiddenPhaseWorkspace choosing_;
  HiddenPhaseWorkspace choosing_equal_;
  HiddenPhaseWorkspace believing_;
  Image<float> whole_;
};

double mean_of(const std::vector<double>& values) {
  double sum = 0.0;
  for (const double value : values) sum += value;
  return sum / static_cast<double>(values.size());
}

/// Draws the same frames for every row, so that rows can be compared.
MeanWithInterval bootstrap(const std::vector<double>& values, int samples) {
  std::vector<double> means;
  for (int sample = 0; sample < samples; ++sample) {
    double sum = 0.0;
    draw_frames(values.size(), kBootstrapSeed, sample, [&](std::size_t i) { sum += values[i]; });
    means.push_back(sum / static_cast<double>(values.size()));
  }
  return {mean_of(values), interval_of(std::move(means))};
}

struct Fields {
  std::vector<Realisation> realisations;
  std::vector<PhaseField> fields;
};

/// The figures of one row, [frames].
struct RowValues {
  std::vector<double> ideal;
  std::vector<double> mirror;
  std::vector<double> vortices;
};

PhaseCellResult run_cell(const CellPlan& plan, const Fields& fields,
                         const PhaseBenchmarkOptions& options) {
  const auto n = fields.fields.size();
  std::vector<RowValues> values(
      kRows, {std::vector<double>(n), std::vector<double>(n), std::vector<double>(n)});
  std::vector<double> true_vortices(n);
  std::vector<std::unique_ptr<Estimator>> estimators(static_cast<std::size_t>(options.threads));
  for_each_in_parallel(static_cast<int>(n), options.threads, [&](int index, int thread) {
    const auto i = static_cast<std::size_t>(index);
    auto& estimator = estimators[static_cast<std::size_t>(thread)];
    if (!estimator) estimator = std::make_unique<Estimator>(plan);
    const Realisation& realisation = fields.realisations[i];
    estimator->measure(realisation, realisation_seed(options.subset, index));
    values[kNone].ideal[i] = values[kNone].mirror[i] = strehl_uncorrected(fields.fields[i]);
    for (std::size_t row = kNone + 1; row < kRows; ++row) {
      const PhaseEstimate estimate = estimator->estimate(static_cast<int>(row), realisation);
      const Strehl strehl = strehl_after(fields.fields[i], estimate);
      values[row].ideal[i] = strehl.ideal;
      values[row].mirror[i] = strehl.mirror;
      values[row].vortices[i] = static_cast<double>(estimate.vortices.size());
    }
    for (const SceneVortex& v : realisation.vortices)
      true_vortices[i] += estimator->on_array(v) ? 1.0 : 0.0;
  });
  const bool weighted = mean_of(values[kWeighted].ideal) > mean_of(values[kEqual].ideal);
  const std::size_t baseline = weighted ? kWeighted : kEqual;
  PhaseCellResult cell;
  cell.rytov_variance = plan.measurement.parameters().rytov_variance;
  cell.photons = plan.measurement.options().photons;
  cell.true_vortices = mean_of(true_vortices);
  cell.baseline = kRowNames[baseline].name;
  for (std::size_t row = 0; row < kRows; ++row) {
    std::vector<double> gain = values[row].ideal;
    for (std::size_t i = 0; i < n; ++i) gain[i] -= values[baseline].ideal[i];
    cell.rows.push_back({kRowNames[row].name, kRowNames[row].method,
                         bootstrap(values[row].ideal, options.bootstrap_samples),
                         bootstrap(values[row].mirror, options.bootstrap_samples),
                         bootstrap(gain, options.bootstrap_samples),
                         mean_of(values[row].vortices)});
  }
  return cell;
}

}  // namespace

std::vector<PhaseCellResult> run_phase_benchmark(const PhaseBenchmarkOptions& options,
                                                 const RealisationCache& realisations,
                                                 const PhaseFieldCache& fields,
                                                 const std::function<void()>& step) {
  std::vector<PhaseCellResult> cells;
  for (const double rytov_variance : options.rytov_variances) {
    FieldParameters parameters = options.field;
    parameters.rytov_variance = rytov_variance;
    const auto n = static_cast<std::size_t>(options.realisations);
    Fields all{std::vector<Realisation>(n), std::vector<PhaseField>(n)};
    std::mutex stepping;
    for_each_in_parallel(options.realisations, options.threads, [&](int i, int) {
      const std::uint64_t seed = realisation_seed(options.subset, i);
      all.realisations[static_cast<std::size_t>(i)] =
          realisations.read_or_simulate(parameters, seed);
      all.fields[static_cast<std::size_t>(i)] = fields.read_or_simulate(parameters, seed);
      const std::scoped_lock lock(stepping);
      step();
    });
    for (const double photons : options.photons) {
      MeasurementOptions measurement = options.measurement;
      measurement.photons = photons;
      cells.push_back(run_cell(CellPlan(parameters, measurement), all, options));
    }
  }
  return cells;
}

}  // namespace curlew
