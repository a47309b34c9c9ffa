#include "service/bench/detection_benchmark.h"

#include <cstddef>
#include <memory>
#include <utility>

#include "core/as_size.h"
#include "service/bench/bench_timing.h"
#include "service/bench/benchmark_fields.h"
#include "service/bench/detection_rows.h"
#include "service/program/parallel.h"

namespace curlew {
namespace {

/// What one detector makes of one subset, frame by frame.
struct Judged {
  explicit Judged(std::size_t frames) : verdicts(frames), finding_us(frames) {}
  std::vector<FrameVerdicts> verdicts;
  std::vector<double> finding_us;
};

/// Judges all detectors on the fields of one subset. measuring_us: [frames], overwritten.
std::vector<Judged> judge(const MeasurementPlan& plan, const std::vector<DetectorRow>& rows,
                          const BenchmarkFields& fields, int threads,
                          std::vector<double>& measuring_us) {
  const auto n = fields.realisations.size();
  std::vector<Judged> judged(rows.size(), Judged(n));
  measuring_us.resize(n);
  std::vector<std::unique_ptr<MeasuredFrame>> frames(as_size(threads));
  const Interior interior{plan.parameters().rows, plan.parameters().cols, &plan.sensor().valid};
  for_each_in_parallel(static_cast<int>(n), threads, [&](int index, int thread) {
    const std::size_t i = as_size(index);
    auto& frame = frames[as_size(thread)];
    if (!frame) frame = std::make_unique<MeasuredFrame>(plan);
    measuring_us[i] = time_us([&] {
      measure_frame(plan, fields.realisations[i], realisation_seed(fields.subset, index), *frame);
    });
    for (std::size_t row = 0; row < rows.size(); ++row) {
      std::vector<Candidate> candidates;
      judged[row].finding_us[i] = time_us([&] { candidates = rows[row].find(*frame); });
      judged[row].verdicts[i] = judge_frame(std::move(candidates), fields.truths[i], interior);
    }
  });
  return judged;
}

DetectionCellResult run_cell(const MeasurementPlan& plan, const BenchmarkFields& validation,
                             const BenchmarkFields& test,
                             const DetectionBenchmarkOptions& options) {
  std::vector<DetectorRow> rows = make_detector_rows(plan, options.controlled_rates);
  if (!options.baselines) {
    std::erase_if(rows, [](const DetectorRow& row) {
      return row.name != "whitened" && row.name != "classifier";
    });
  }
  std::vector<double> measuring_us;
  const auto chosen_on = judge(plan, rows, validation, options.threads, measuring_us);
  const auto stated_on = judge(plan, rows, test, options.threads, measuring_us);
  DetectionCellResult cell;
  cell.rytov_variance = plan.parameters().rytov_variance;
  cell.photons = plan.options().photons;
  cell.measuring_ms = 1e-3 * median(measuring_us);
  for (std::size_t row = 0; row < rows.size(); ++row) {
    const DetectionRecord record(stated_on[row].verdicts);
    cell.required = record.required();
    DetectionRowResult result;
    result.name = rows[row].name;
    result.method = rows[row].method;
    result.threshold = DetectionRecord(chosen_on[row].verdicts).best_threshold();
    result.score = record.score(result.threshold);
    result.samples = record.bootstrap(result.threshold, options.bootstrap_samples, kBootstrapSeed);
    result.false_at_half = record.false_alarms(0.5);
    result.microseconds = median(stated_on[row].finding_us);
    cell.rows.push_back(std::move(result));
  }
  return cell;
}

}  // namespace

void for_each_cell(
    const DetectionBenchmarkOptions& options, const RealisationCache& cache,
    const std::function<void()>& step,
    const std::function<void(const MeasurementPlan&, const BenchmarkFields& validation,
                             const BenchmarkFields& test)>& take) {
  for (const double rytov_variance : options.rytov_variances) {
    FieldParameters field = options.field;
    field.rytov_variance = rytov_variance;
    const BenchmarkFields validation = load_fields(
        field, Subset::kValidation, options.validation_realisations, options.threads, cache, step);
    const BenchmarkFields test =
        load_fields(field, Subset::kTest, options.test_realisations, options.threads, cache, step);
    for (const double photons : options.photons) {
      MeasurementOptions measurement = options.measurement;
      measurement.photons = photons;
      take(MeasurementPlan(field, measurement), validation, test);
    }
  }
}

std::vector<DetectionCellResult> run_detection_benchmark(const DetectionBenchmarkOptions& options,
                                                         const RealisationCache& cache,
                                                         const std::function<void()>& step) {
  std::vector<DetectionCellResult> cells;
  for_each_cell(options, cache, step,
                [&](const MeasurementPlan& plan, const BenchmarkFields& validation,
                    const BenchmarkFields& test) {
                  cells.push_back(run_cell(plan, validation, test, options));
                });
  return cells;
}

}  // namespace curlew
