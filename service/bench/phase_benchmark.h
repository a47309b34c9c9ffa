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
  /// Its photons are not used; without noise the method is always plain.
  MeasurementOptions measurement;
  Subset subset = Subset::kTest;
  int realisations = 100;
  int bootstrap_samples = 1000;
  int threads = 1;
};

/// A mean over the realisations, and the interval that holds 95 % of its bootstrap.
struct MeanWithInterval {
  double value = 0.0;
  Interval interval;
};

/// One way of estimating the phase, in one cell.
struct PhaseRowResult {
  std::string name;
  std::string method;
  MeanWithInterval strehl;  ///< after ideal correction
  MeanWithInterval mirror;  ///< after correction by a mirror that cannot jump
  /// The gain of strehl over the better least-squares row of the cell, paired by frame.
  MeanWithInterval gain;
  double vortices = 0.0;  ///< vortices that the estimate holds, a frame
};

struct PhaseCellResult {
  double rytov_variance = 0.0;
  double photons = 0.0;
  double true_vortices = 0.0;  ///< true vortices on the array, a frame
  std::string baseline;        ///< name of the better least-squares row
  std::vector<PhaseRowResult> rows;
};

/// step is called whenever a realisation was made or read, and may throw to end the run. The
/// results do not depend on the number of threads.
std::vector<PhaseCellResult> run_phase_benchmark(const PhaseBenchmarkOptions& options,
                                                 const RealisationCache& realisations,
                                                 const PhaseFieldCache& fields,
                                                 const std::function<void()>& step);

/// How long add_hidden_phase takes on size × size lenslets, in µs. There are opposite pairs of
/// vortices two pitches apart, noise of .2 rad a pitch, and as many false candidates as true ones.
struct PhaseTiming {
  int size = 0;
  int vortices = 0;
  double whole_us = 0.0;   ///< all of it, median of a frame
  double min_us = 0.0;     ///< the fastest frame, which had the core to itself
  double choice_us = 0.0;  ///< choosing the vortices, median
  double field_us = 0.0;   ///< the vortices' phase and slopes, median
  double cuts_us = 0.0;    ///< the branch cuts, median
  double split_us = 0.0;   ///< least squares, median; a split without hidden phase takes as long
};
PhaseTiming time_hidden_phase(int size, int vortices, int frames);

}  // namespace curlew
