// The frozen fields of a benchmark's subset, and the truth that detectors are measured against.
#pragma once

#include <functional>
#include <vector>

#include "service/bench/detection_dataset.h"
#include "service/bench/detection_score.h"

namespace curlew {

/// The realisations of one subset behind one turbulence, and the graded truth of each.
struct BenchmarkFields {
  Subset subset;
  std::vector<Realisation> realisations;
  std::vector<std::vector<GradedVortex>> truths;
};

/// Reads the first n of the subset from the cache, or simulates them. step is called after each, by
/// one thread at a time, and may throw to end the work.
BenchmarkFields load_fields(const FieldParameters& parameters, Subset subset, int n, int threads,
                            const RealisationCache& cache, const std::function<void()>& step);

}  // namespace curlew
