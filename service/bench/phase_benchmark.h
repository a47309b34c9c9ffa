// The benchmark of the whole phase: Strehl with the hidden phase against least squares alone.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "service/bench/detection_measurement.h"
#include "service/bench/detection_score.h"
#include "service/bench/phase_field.h"

namespace curlew {

struct PhaseBenchmarkOptions {
  FieldParameters field;  ///< its Rytov variance is not used
  std::vector<double> rytov_variances{1.0, 2.0, 4.0};
  std::vector<double> photons{kWithoutNoise, 1000.0, 200.0};
  MeasurementOptions measurement;  ///< its photons are not used; without noise always plain
  Subset subset = Subset::kTest;
  int realisations = 100;
  int bootstrap_samples = 1000;
  int threads = 1;
};

/// A mean over the realisations and the interval that holds 95 % of its bootstrap.
struct MeanWithInterval {
  double value = 0.0;
  Interval interval;
};

/// One way of estimating the phase, in one cell.
struct PhaseRowResult {
  std::string name;
  std::string method;
  MeanWithInterval strehl;  ///< after ideal correction
  MeanWithInterval mirror;  ///< by a mirror that cannot jump
  /// strehl less that of the better least-squares row of the cell, paired by frame.
  MeanWithInterval gain;
  double vortices = 0.0;  ///< a frame, that the estimate holds
};

struct PhaseCellResult {
  double rytov_variance = 0.0;
  double photons = 0.0;
  double true_vortices = 0.0;  ///< a frame, on the array
  std::string baseline;        ///< name of the better least-squares row
  std::vector<PhaseRowResult> rows;
};

/// step is called whenever a realisation has been made or read, and may throw to end the run.
/// The results do not depend on how many threads there are.
std::vector<PhaseCellResult> run_phase_benchmark(const PhaseBenchmarkOptions& options,
                                                 const RealisationCache& realisations,
                                                 const PhaseFieldCache& fields,
                                                 const std::function<void()>& step);

/// How long add_hidden_phase takes on size × size lenslets with opposite pairs of vortices two
/// pitches apart, noise of .2 rad a pitch and as many false candidates as true ones, µs.
struct PhaseTiming {
  int size = 0;
  int vortices = 0;
  double whole_us = 0.0;   ///< median of a frame, all of it
  double min_us = 0.0;     ///< the fastest frame: what it takes when nobody else takes the core
  double choice_us = 0.0;  ///< medians of its parts: choosing,
  double field_us = 0.0;   ///< the vortices' phase and slopes,
  double cuts_us = 0.0;    ///< the cuts,
  double split_us = 0.0;   ///< and least squares, as long as a split without hidden phase
};
PhaseTiming time_hidden_phase(int size, int vortices, int frames);

}  // namespace curlew
