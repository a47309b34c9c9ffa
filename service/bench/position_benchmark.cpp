#include "service/bench/position_benchmark.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <mutex>
#include <utility>

#include "acquisition/simulator/field_vortices.h"
#include "core/as_size.h"
#include "service/bench/bench_timing.h"
#include "service/bench/benchmark_fields.h"
#include "service/bench/bootstrap.h"
#include "service/bench/detection_rows.h"
#include "service/program/parallel.h"
#include "service/results/truth_match.h"

namespace curlew {
namespace {

double root_mean(double sum, double n) {
  return n > 0.0 ? std::sqrt(sum / n) : std::numeric_limits<double>::quiet_NaN();
}

/// Learns the modes from the training fields, each of which as many lenslets see as the propagated
/// grid has.
FieldModes learn_modes(const PositionBenchmarkOptions& options, const FieldParameters& field,
                       const std::function<void()>& step) {
  const PropagationGrid grid = propagation_grid(simulator_options(field, 0));
  FieldParameters whole = field;
  whole.rows = whole.cols =
      std::max(field.rows, grid.points / grid.samples_per_lenslet - 2 * grid.margin);
  FieldModeEstimator estimator(kBoundLenslets.back(), grid.samples_per_lenslet * grid.finer,
                               options.polynomials);
  std::mutex adding;
  // The fields are added in their order, whichever is ready first, because sums of doubles depend
  // on the order. Only so many are kept at once.
  constexpr int kAtOnce = 8;
  for (int first = 0; first < options.training_realisations; first += kAtOnce) {
    const int n = std::min(kAtOnce, options.training_realisations - first);
    std::vector<SampledField> fields(as_size(n));
    for_each_in_parallel(n, options.threads, [&](int i, int) {
      fields[as_size(i)] =
          simulate_true_field(whole, realisation_seed(Subset::kTraining, first + i));
      const std::scoped_lock lock(adding);
      step();
    });
    for (const SampledField& each : fields)
      estimator.add(each, grade_vortices(find_field_vortices(each)), whole.rows, whole.cols);
  }
  return estimator.modes(options.modes);
}

/// The required vortices of a test field, and their bounds at every flux.
struct BoundedField {
  std::vector<PositionVortex> vortices;
  std::vector<std::size_t> truth;  ///< the vortices' indices in the graded truth
  /// The bounds, by vortex and then by flux in the order of options.photons.
  std::vector<std::vector<std::array<VortexBound, 2>>> bounds;
};

BoundedField bound_field(const PositionBenchmarkOptions& options, const FieldParameters& field,
                         int index, const std::vector<GradedVortex>& truth, const FieldModes& modes,
                         const SpotDerivative& spots, const PixelInformation& information) {
  const Interior interior{field.rows, field.cols};
  const SampledField true_field =
      simulate_true_field(field, realisation_seed(Subset::kTest, index));
  BoundedField result;
  for (std::size_t v = 0; v < truth.size(); ++v) {
    if (!truth[v].required || !interior.contains(truth[v].x, truth[v].y)) continue;
    const VortexView view = view_vortex(true_field, truth[v], field.rows, field.cols, modes, spots);
    PositionVortex vortex;
    vortex.field = index;
    vortex.truth = truth[v];
    vortex.light = 0.25 * view.light.head(view.pixels_within.front()).sum();
    vortex.nearest = std::numeric_limits<double>::infinity();
    for (std::size_t o = 0; o < truth.size(); ++o) {
      if (o == v) continue;
      vortex.nearest =
          std::min(vortex.nearest, std::hypot(truth[o].x - truth[v].x, truth[o].y - truth[v].y));
    }
    result.vortices.push_back(vortex);
    result.truth.push_back(v);
    std::vector<std::array<VortexBound, 2>> bounds(options.photons.size());
    for (std::size_t b = 0; b < kBoundLenslets.size(); ++b) {
      const auto covariances =
          position_covariances(view, kBoundLenslets[b], options.photons, information);
      for (std::size_t level = 0; level < covariances.size(); ++level)
        bounds[level][b] = {covariances[level].trace(),
                            truncate_error(covariances[level], kHitRadius)};
    }
    result.bounds.push_back(std::move(bounds));
  }
  return result;
}

std::vector<FrameVerdicts> judge(const MeasurementPlan& plan, const DetectorRow& row,
                                 const BenchmarkFields& fields) {
  const Interior interior{plan.parameters().rows, plan.parameters().cols};
  std::vector<FrameVerdicts> verdicts;
  MeasuredFrame frame(plan);
  for (std::size_t i = 0; i < fields.realisations.size(); ++i) {
    measure_frame(plan, fields.realisations[i],
                  realisation_seed(fields.subset, static_cast<int>(i)), frame);
    verdicts.push_back(judge_frame(row.find(frame), fields.truths[i], interior));
  }
  return verdicts;
}

using Chosen = std::vector<const PositionVortex*>;

std::vector<PositionScore> bootstrap(const std::vector<PositionVortex>& vortices, int fields,
                                     int samples) {
  std::vector<Chosen> by_field(as_size(fields));
  for (const PositionVortex& vortex : vortices) by_field[as_size(vortex.field)].push_back(&vortex);
  std::vector<PositionScore> scores;
  for (int sample = 0; sample < samples; ++sample) {
    Chosen drawn;
    draw_frames(by_field.size(), kBootstrapSeed, sample, [&](std::size_t i) {
      drawn.insert(drawn.end(), by_field[i].begin(), by_field[i].end());
    });
    scores.push_back(score_positions(drawn));
  }
  return scores;
}

std::vector<PositionClass> classify(const std::vector<PositionVortex>& vortices) {
  std::vector<double> lights;
  lights.reserve(vortices.size());
  for (const PositionVortex& vortex : vortices) lights.push_back(vortex.light);
  const double middle = median(lights);
  // Another vortex within this many pitches is a near one.
  constexpr double kNear = 1.5;
  // A vortex within this many pitches of a lenslet's border lies at that border.
  constexpr double kEdge = 0.25;
  const auto to_border = [](const PositionVortex& v) {
    const auto one = [](double at) { return std::abs(at - std::floor(at) - 0.5); };
    return std::make_pair(one(v.truth.x), one(v.truth.y));
  };
  const auto borders = [&](const PositionVortex& v) {
    const auto [x, y] = to_border(v);
    return (x < kEdge ? 1 : 0) + (y < kEdge ? 1 : 0);
  };
  const auto score = [&](auto&& holds) {
    Chosen chosen;
    for (const PositionVortex& vortex : vortices)
      if (holds(vortex)) chosen.push_back(&vortex);
    return score_positions(chosen);
  };
  return {
      {"darker half", score([&](const auto& v) { return v.light < middle; })},
      {"brighter half", score([&](const auto& v) { return v.light >= middle; })},
      {"another within 1.5", score([&](const auto& v) { return v.nearest < kNear; })},
      {"none within 1.5", score([&](const auto& v) { return v.nearest >= kNear; })},
      {"at a lenslet's corner", score([&](const auto& v) { return borders(v) == 2; })},
      {"at its side", score([&](const auto& v) { return borders(v) == 1; })},
      {"at its centre", score([&](const auto& v) { return borders(v) == 0; })},
  };
}

std::vector<BoundedField> bound_fields(const PositionBenchmarkOptions& options,
                                       const FieldParameters& field, const BenchmarkFields& test,
                                       const FieldModes& modes, const PixelInformation& information,
                                       const std::function<void()>& step) {
  const SpotDerivative spots(modes.samples, field.samples_per_lambda_w, field.window_px);
  std::vector<BoundedField> bounded(as_size(options.test_realisations));
  std::mutex stepping;
  for_each_in_parallel(options.test_realisations, options.threads, [&](int i, int) {
    bounded[as_size(i)] =
        bound_field(options, field, i, test.truths[as_size(i)], modes, spots, information);
    const std::scoped_lock lock(stepping);
    step();
  });
  return bounded;
}

/// What the classifier makes of the test fields at one flux.
struct ClassifierResult {
  double threshold;                     ///< candidates of this score or a higher one are believed
  std::vector<FrameVerdicts> verdicts;  ///< one for each test field
};

/// Chooses the classifier's threshold on the validation fields, then runs it on the test fields.
ClassifierResult run_classifier(const MeasurementPlan& plan, const BenchmarkFields& validation,
                                const BenchmarkFields& test) {
  const std::vector<DetectorRow> rows = make_detector_rows(plan);
  const auto classifier = std::find_if(
      rows.begin(), rows.end(), [](const DetectorRow& row) { return row.name == "classifier"; });
  return {.threshold = DetectionRecord(judge(plan, *classifier, validation)).best_threshold(),
          .verdicts = judge(plan, *classifier, test)};
}

/// Adds to each vortex its bounds at one flux, photons[level], and whether the classifier hit it.
std::vector<PositionVortex> join(const std::vector<BoundedField>& bounded, std::size_t level,
                                 const ClassifierResult& classifier) {
  std::vector<PositionVortex> vortices;
  for (std::size_t i = 0; i < bounded.size(); ++i) {
    for (std::size_t v = 0; v < bounded[i].vortices.size(); ++v) {
      PositionVortex vortex = bounded[i].vortices[v];
      vortex.bounds = bounded[i].bounds[v][level];
      for (const Verdict& verdict : classifier.verdicts[i].verdicts) {
        if (!verdict.hit || verdict.score < classifier.threshold ||
            verdict.vortex != static_cast<int>(bounded[i].truth[v]))
          continue;
        vortex.hit = true;
        vortex.error = verdict.error;
      }
      vortices.push_back(vortex);
    }
  }
  return vortices;
}

/// Fills in all scores of a cell, whose vortices are given.
void score_cell(const PositionBenchmarkOptions& options, PositionCellResult& cell) {
  Chosen all;
  for (const PositionVortex& vortex : cell.vortices) all.push_back(&vortex);
  cell.score = score_positions(all);
  cell.samples = bootstrap(cell.vortices, options.test_realisations, options.bootstrap_samples);
  cell.classes = classify(cell.vortices);
}

/// Adds the cells of one turbulence, one for each flux.
void run_turbulence(const PositionBenchmarkOptions& options, const FieldParameters& field,
                    const PixelInformation& information, const RealisationCache& cache,
                    const std::function<void()>& step, std::vector<PositionCellResult>& cells) {
  const FieldModes modes = learn_modes(options, field, step);
  const BenchmarkFields validation = load_fields(
      field, Subset::kValidation, options.validation_realisations, options.threads, cache, step);
  const BenchmarkFields test =
      load_fields(field, Subset::kTest, options.test_realisations, options.threads, cache, step);
  const std::vector<BoundedField> bounded =
      bound_fields(options, field, test, modes, information, step);
  for (std::size_t level = 0; level < options.photons.size(); ++level) {
    MeasurementOptions measurement = options.measurement;
    measurement.photons = options.photons[level];
    const MeasurementPlan plan(field, measurement);
    PositionCellResult cell;
    cell.rytov_variance = field.rytov_variance;
    cell.photons = measurement.photons;
    cell.mode_power = modes.power;
    cell.learnt_from = modes.patches;
    cell.vortices = join(bounded, level, run_classifier(plan, validation, test));
    score_cell(options, cell);
    cells.push_back(std::move(cell));
  }
}

}  // namespace

PositionScore score_positions(const std::vector<const PositionVortex*>& vortices) {
  PositionScore score;
  score.vortices = static_cast<int>(vortices.size());
  std::vector<double> errors;
  double squares = 0.0;
  for (const PositionVortex* vortex : vortices) {
    if (!vortex->hit) continue;
    errors.push_back(vortex->error);
    squares += vortex->error * vortex->error;
  }
  score.hits = static_cast<int>(errors.size());
  score.rms = root_mean(squares, score.hits);
  score.median = median(errors);
  for (std::size_t b = 0; b < kBoundLenslets.size(); ++b) {
    double hits = 0.0, uncut = 0.0, all = 0.0, within = 0.0;
    std::vector<double> singles;
    for (const PositionVortex* vortex : vortices) {
      const VortexBound& bound = vortex->bounds[b];
      all += bound.hit.probability * bound.hit.square;
      within += bound.hit.probability;
      if (!vortex->hit) continue;
      hits += bound.hit.square;
      uncut += bound.variance;
      singles.push_back(std::sqrt(std::max(bound.variance, 0.0)));
    }
    score.bounds[b] = {root_mean(hits, score.hits), root_mean(uncut, score.hits), median(singles),
                       root_mean(all, within), within / score.vortices};
  }
  return score;
}

std::vector<PositionCellResult> run_position_benchmark(const PositionBenchmarkOptions& options,
                                                       const RealisationCache& cache,
                                                       const std::function<void()>& step) {
  const PixelInformation information(options.measurement.read_noise_e);
  std::vector<PositionCellResult> cells;
  for (const double rytov_variance : options.rytov_variances) {
    FieldParameters field = options.field;
    field.rytov_variance = rytov_variance;
    run_turbulence(options, field, information, cache, step, cells);
  }
  return cells;
}

}  // namespace curlew
