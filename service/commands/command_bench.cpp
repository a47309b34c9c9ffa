#include <CLI/CLI.hpp>

#include "service/commands/commands.h"

namespace curlew {

void add_bench(CLI::App& app) {
  CLI::App* bench = app.add_subcommand("bench", "Benchmarks; never from a debug build");
  bench->require_subcommand(1);
  add_bench_latency(*bench);
  add_bench_stream(*bench);
  add_bench_centroid(*bench);
  add_bench_split(*bench);
  add_bench_circulation(*bench);
  add_bench_detect(*bench);
  add_bench_train(*bench);
  add_bench_classifier(*bench);
  add_bench_false_alarms(*bench);
  add_bench_phase(*bench);
  add_bench_bound(*bench);
  add_bench_track(*bench);
}

}  // namespace curlew
