#include "service/bench/benchmark_fields.h"

#include <cstddef>
#include <mutex>

#include "service/bench/field_light.h"
#include "service/program/parallel.h"

namespace curlew {

BenchmarkFields load_fields(const FieldParameters& parameters, Subset subset, int n, int threads,
                            const RealisationCache& cache, const std::function<void()>& step) {
  const auto count = static_cast<std::size_t>(n);
  BenchmarkFields fields{subset, std::vector<Realisation>(count),
                         std::vector<std::vector<GradedVortex>>(count)};
  const bool turns = parameters.rotation_deg != 0.0;
  const FieldParameters simulated = turns ? before_turning(parameters) : parameters;
  std::mutex stepping;
  for_each_in_parallel(n, threads, [&](int i, int) {
    const auto k = static_cast<std::size_t>(i);
    fields.realisations[k] = cache.read_or_simulate(simulated, realisation_seed(subset, i));
    if (turns) fields.realisations[k].light = turned(fields.realisations[k].light, parameters);
    fields.truths[k] = grade_vortices(fields.realisations[k].vortices);
    const std::scoped_lock lock(stepping);
    step();
  });
  return fields;
}

}  // namespace curlew
