#include "service/detection_benchmark.h"

#include <chrono>
#include <cstddef>
#include <memory>
#include <mutex>

#include "service/detection_rows.h"
#include "service/parallel.h"

namespace curlew {
namespace {

constexpr std::uint64_t kBootstrapSeed = 20070401;

using Clock = std::chrono::steady_clock;
double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

std::size_t size(int n) { return static_cast<std::size_t>(n); }

/// The realisations of one subset, behind one turbulence.
struct Fields {
  Subset subset;
  std::vector<Realisation> realisations;
  std::vector<std::vector<GradedVortex>> truths;
};

Fields load_fields(const FieldParameters& parameters, Subset subset, int n, int threads,
                   const RealisationCache& cache, const std::function<void()>& step) {
  Fields fields{subset, std::vector<Realisation>(size(n)),
                std::vector<std::vector<GradedVortex>>(size(n))};
  std::mutex stepping;
  for_each_in_parallel(n, threads, [&](int i, int) {
    Realisation& realisation = fields.realisations[size(i)];
    realisation = cache.read_or_simulate(parameters, realisation_seed(subset, i));
    fields.truths[size(i)] = grade_vortices(realisation.vortices);
    const std::scoped_lock lock(stepping);
    step();
  });
  return fields;
}

/// What all detectors make of one subset: [row][frame].
struct Judged {
  std::vector<std::vector<FrameVerdicts>> verdicts;
  std::vector<double> finding_s;  // [row], of all frames
  double measuring_s = 0.0;
};

Judged judge(const MeasurementPlan& plan, const std::vector<DetectorRow>& rows,
             const Fields& fields, int threads) {
  const auto n = fields.realisations.size();
  Judged judged{std::vector(rows.size(), std::vector<FrameVerdicts>(n)),
                std::vector<double>(rows.size()), 0.0};
  std::vector<std::unique_ptr<MeasuredFrame>> frames(size(threads));
  const Interior interior{plan.parameters().rows, plan.parameters().cols};
  std::mutex adding;
  for_each_in_parallel(static_cast<int>(n), threads, [&](int i, int thread) {
    auto& frame = frames[size(thread)];
    if (!frame) frame = std::make_unique<MeasuredFrame>(plan);
    const Clock::time_point start = Clock::now();
    measure_frame(plan, fields.realisations[size(i)], realisation_seed(fields.subset, i), *frame);
    const double measuring_s = seconds_since(start);
    for (std::size_t row = 0; row < rows.size(); ++row) {
      const Clock::time_point asked = Clock::now();
      std::vector<Candidate> candidates = rows[row].find(*frame);
      const double finding_s = seconds_since(asked);
      judged.verdicts[row][size(i)] =
          judge_frame(std::move(candidates), fields.truths[size(i)], interior);
      const std::scoped_lock lock(adding);
      judged.finding_s[row] += finding_s;
    }
    const std::scoped_lock lock(adding);
    judged.measuring_s += measuring_s;
  });
  return judged;
}

DetectionCellResult run_cell(const MeasurementPlan& plan, const Fields& validation,
                             const Fields& test, const DetectionBenchmarkOptions& options) {
  const std::vector<DetectorRow> rows = make_detector_rows(plan);
  const Judged chosen_on = judge(plan, rows, validation, options.threads);
  const Judged stated_on = judge(plan, rows, test, options.threads);
  DetectionCellResult cell;
  cell.rytov_variance = plan.parameters().rytov_variance;
  cell.photons = plan.options().photons;
  const auto n = static_cast<double>(test.realisations.size());
  cell.measuring_ms = 1e3 * stated_on.measuring_s / n;
  for (std::size_t row = 0; row < rows.size(); ++row) {
    const DetectionRecord record(stated_on.verdicts[row]);
    cell.required = record.required();
    DetectionRowResult result;
    result.name = rows[row].name;
    result.method = rows[row].method;
    result.threshold = DetectionRecord(chosen_on.verdicts[row]).best_threshold();
    result.score = record.score(result.threshold);
    result.samples = record.bootstrap(result.threshold, options.bootstrap_samples, kBootstrapSeed);
    result.microseconds = 1e6 * stated_on.finding_s[row] / n;
    cell.rows.push_back(std::move(result));
  }
  return cell;
}

}  // namespace

std::vector<DetectionCellResult> run_detection_benchmark(const DetectionBenchmarkOptions& options,
                                                         const RealisationCache& cache,
                                                         const std::function<void()>& step) {
  std::vector<DetectionCellResult> cells;
  for (const double rytov_variance : options.rytov_variances) {
    FieldParameters field = options.field;
    field.rytov_variance = rytov_variance;
    const Fields validation = load_fields(
        field, Subset::kValidation, options.validation_realisations, options.threads, cache, step);
    const Fields test =
        load_fields(field, Subset::kTest, options.test_realisations, options.threads, cache, step);
    for (const double photons : options.photons) {
      MeasurementOptions measurement = options.measurement;
      measurement.photons = photons;
      const MeasurementPlan plan(field, measurement);
      cells.push_back(run_cell(plan, validation, test, options));
    }
  }
  return cells;
}

}  // namespace curlew
