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
  /// Its photons are not used; without noise the method is always plain.
  MeasurementOptions measurement;
  int test_realisations = 40;
  int validation_realisations = 60;  ///< the classifier's threshold is chosen on these
  /// The modes are learnt from these, each of which as many lenslets see as the propagated grid
  /// has.
  int training_realisations = 30;
  int polynomials = 24;  ///< along an axis of 6 lenslets
  int modes = 400;       ///< number of complex modes
  int bootstrap_samples = 1000;
  int threads = 1;
};

/// What the spots of so many lenslets allow at best for one vortex.
struct VortexBound {
  double variance = 0.0;  ///< of the distance, both axes together, pitches²
  TruncatedError hit;     ///< the errors within kHitRadius
};
inline constexpr std::array<int, 2> kBoundLenslets = {4, 6};  ///< lenslets along a side

/// One required vortex of a test field.
struct PositionVortex {
  int field = 0;
  GradedVortex truth;
  /// Mean over the four lenslets round its node; 1: that of a lenslet of amplitude 1.
  double light = 0.0;
  double nearest = 0.0;  ///< distance of the nearest other vortex, required or not, pitches
  bool hit = false;      ///< whether the classifier hits it
  double error = 0.0;    ///< distance of the hit, pitches
  std::array<VortexBound, 2> bounds;  ///< in the order of kBoundLenslets
};

/// The scores of some vortices, in pitches. They are NaN if there are none.
struct PositionScore {
  struct Bound {
    /// Rms for the vortices that the classifier hits, of the errors within the hit radius.
    double hits = 0.0;
    double uncut = 0.0;   ///< rms for the same vortices, of all errors
    double median = 0.0;  ///< median of the rms of each of these vortices, of all errors
    double all = 0.0;     ///< rms for all vortices, of the errors within the hit radius
    double within = 0.0;  ///< part of the errors that lie within the hit radius, for all vortices
  };
  int vortices = 0;
  int hits = 0;
  double rms = 0.0;  ///< the classifier's, of its hits
  double median = 0.0;
  std::array<Bound, 2> bounds;  ///< in the order of kBoundLenslets
};
PositionScore score_positions(const std::vector<const PositionVortex*>& vortices);

/// A kind of vortices, to show where the classifier loses.
struct PositionClass {
  std::string_view name;
  PositionScore score;
};

struct PositionCellResult {
  double rytov_variance = 0.0;
  double photons = 0.0;
  double mode_power = 0.0;  ///< part of the field's power that the modes hold
  int learnt_from = 0;      ///< number of vortices that the modes are learnt from
  std::vector<PositionVortex> vortices;
  PositionScore score;
  std::vector<PositionScore> samples;  ///< each from as many fields, drawn with replacement
  std::vector<PositionClass> classes;
};

/// step is called whenever a field was made or read, and may throw to end the run. The results do
/// not depend on the number of threads.
std::vector<PositionCellResult> run_position_benchmark(const PositionBenchmarkOptions& options,
                                                       const RealisationCache& cache,
                                                       const std::function<void()>& step);

}  // namespace curlew
