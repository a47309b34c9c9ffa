// The benchmark of positions: what the classifier reaches, and what the spots allow at best.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "service/bench/detection_dataset.h"
#include "service/bench/detection_measurement.h"
#include "service/bench/detection_score.h"
#include "service/bench/position_bound.h"

namespace curlew {

struct PositionBenchmarkOptions {
  FieldParameters field;  ///< its Rytov variance is not used
  std::vector<double> rytov_variances{1.0, 2.0, 4.0};
  std::vector<double> photons{kWithoutNoise, 1000.0, 200.0};
  MeasurementOptions measurement;  ///< its photons are not used; without noise always plain
  int test_realisations = 40;
  int validation_realisations = 60;  ///< the classifier's threshold is chosen on
  /// The modes are learnt from, seen by as many lenslets as the propagated grid has.
  int training_realisations = 30;
  int polynomials = 24;  ///< an axis of 6 lenslets
  int modes = 400;       ///< complex ones
  int bootstrap_samples = 1000;
  int threads = 1;
};

/// What the spots of so many lenslets allow for one vortex.
struct VortexBound {
  double variance = 0.0;  ///< of the distance, pitches²: both axes together
  TruncatedError hit;     ///< errors within kHitRadius
};
inline constexpr std::array<int, 2> kBoundLenslets = {4, 6};  ///< a side

/// One required vortex of a test field.
struct PositionVortex {
  int field = 0;
  GradedVortex truth;
  double light = 0.0;    ///< mean of the four lenslets round its node; 1: a lenslet of amplitude 1
  double nearest = 0.0;  ///< other vortex, required or not, pitches
  bool hit = false;      ///< by the classifier
  double error = 0.0;    ///< of the hit, pitches
  std::array<VortexBound, 2> bounds;  ///< by kBoundLenslets
};

/// Of some vortices; pitches. NaN where there are none.
struct PositionScore {
  struct Bound {
    double hits = 0.0;    ///< of those that the classifier hits, rms, errors cut off as its own
    double uncut = 0.0;   ///< the same, no error cut off
    double median = 0.0;  ///< of their single rms, no error cut off
    double all = 0.0;     ///< of all vortices, rms of the errors within the hit radius
    double within = 0.0;  ///< part of errors that are, of all vortices
  };
  int vortices = 0;
  int hits = 0;
  double rms = 0.0;  ///< the classifier's, of its hits
  double median = 0.0;
  std::array<Bound, 2> bounds;  ///< by kBoundLenslets
};
PositionScore score_positions(const std::vector<const PositionVortex*>& vortices);

/// Kinds of vortices: where the classifier loses.
struct PositionClass {
  std::string_view name;
  PositionScore score;
};

struct PositionCellResult {
  double rytov_variance = 0.0;
  double photons = 0.0;
  double mode_power = 0.0;  ///< part of the field's power that the modes hold
  int learnt_from = 0;      ///< vortices
  std::vector<PositionVortex> vortices;
  PositionScore score;
  std::vector<PositionScore> samples;  ///< as many fields drawn with replacement
  std::vector<PositionClass> classes;
};

/// step is called whenever a field has been made or read, and may throw to end the run. The results
/// do not depend on how many threads there are.
std::vector<PositionCellResult> run_position_benchmark(const PositionBenchmarkOptions& options,
                                                       const RealisationCache& cache,
                                                       const std::function<void()>& step);

}  // namespace curlew
