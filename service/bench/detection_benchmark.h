// The benchmark of detection: every detector in every cell of Rytov variance and photons.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "service/bench/benchmark_fields.h"
#include "service/bench/detection_dataset.h"
#include "service/bench/detection_measurement.h"
#include "service/bench/detection_score.h"

namespace curlew {

struct DetectionBenchmarkOptions {
  FieldParameters field;  ///< its Rytov variance is not used
  std::vector<double> rytov_variances{1.0, 2.0, 4.0};
  std::vector<double> photons{kWithoutNoise, 1000.0, 200.0};
  /// Its photons are not used; without noise the method is always plain.
  MeasurementOptions measurement;
  int test_realisations = 100;
  int validation_realisations = 60;
  int bootstrap_samples = 1000;
  bool baselines = true;  ///< false: only the rows whitened and classifier
  /// Each adds rows, held to this rate of false alarms a frame.
  std::vector<double> controlled_rates{};
  int threads = 1;
};

/// The result of one detector in one cell.
struct DetectionRowResult {
  std::string name;
  std::string method;
  double threshold = 0.0;  ///< the best for the validation subset
  DetectionScore score;    ///< score on the test subset
  std::vector<DetectionScore> samples;
  /// False alarms a frame of score .5 or more, for detectors whose score is a probability.
  double false_at_half = 0.0;
  double microseconds = 0.0;  ///< µs a frame, median
};

struct DetectionCellResult {
  double rytov_variance = 0.0;
  double photons = 0.0;
  int required = 0;           ///< required vortices in the test subset
  double measuring_ms = 0.0;  ///< ms a frame, median
  std::vector<DetectionRowResult> rows;
};

/// Gives each cell of the options, one variance and one light level, with its subsets. step is
/// called whenever a realisation was made or read, and may throw to end the run.
void for_each_cell(
    const DetectionBenchmarkOptions& options, const RealisationCache& cache,
    const std::function<void()>& step,
    const std::function<void(const MeasurementPlan&, const BenchmarkFields& validation,
                             const BenchmarkFields& test)>& take);

/// step: see for_each_cell(). Threads take realisations in turn; the results do not depend on the
/// number of threads.
std::vector<DetectionCellResult> run_detection_benchmark(const DetectionBenchmarkOptions& options,
                                                         const RealisationCache& cache,
                                                         const std::function<void()>& step);

}  // namespace curlew
