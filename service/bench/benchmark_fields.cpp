#include "service/bench/benchmark_fields.h"

#include <cstddef>
#include <mutex>

#include "service/program/parallel.h"

namespace curlew {

BenchmarkFields load_fields(const FieldParameters& parameters, Subset subset, int n, int threads,
                            const RealisationCache& cache, const std::function<void()>& step) {
  const auto count = static_cast<std::size_t>(n);
  BenchmarkFields fields{subset, std::vector<Realisation>(count),
                         std::vector<std::vector<GradedVortex>>(count)};
  std::mutex stepping;
  for_each_in_parallel(n, threads, [&](int i, int) {
    const auto k = static_cast<std::size_t>(i);
    fields.realisations[k] = cache.read_or_simulate(parameters, realisation_seed(subset, i));
    fields.truths[k] = grade_vortices(fields.realisations[k].vortices);
    const std::scoped_lock lock(stepping);
    step();
  });
  return fields;
}

}  // namespace curlew
