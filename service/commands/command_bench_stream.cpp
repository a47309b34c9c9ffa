#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <cstdint>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "service/bench/bench_options.h"
#include "service/bench/bench_run.h"
#include "service/bench/stream_benchmark.h"
#include "service/commands/commands.h"
#include "service/program/progress.h"
#include "service/results/latency_report.h"

namespace curlew {
namespace {

struct StreamBenchOptions {
  BenchSize size;
  BenchRounds rounds;
};

nlohmann::ordered_json json_of(const StreamBenchmark& result) {
  return {{"rows", result.which.rows},
          {"cols", result.which.cols},
          {"window_px", result.which.window_px},
          {"rows_at_once", result.rows_at_once},
          {"same_bits", result.same},
          {"whole", times_json(result.whole)},
          {"streamed", times_json(result.streamed)},
          {"ahead", times_json(result.ahead)},
          {"slowest", times_json(result.slowest)},
          {"plain_rows", times_json(result.plain_rows)},
          {"read", times_json(result.read)},
          {"streamed_over_whole", result.streamed.median_us / result.whole.median_us},
          {"streamed_over_read", result.streamed.median_us / result.read.median_us}};
}

std::string table(const StreamBenchmark& result) {
  std::string text = fmt::format(
      "\n{} x {} lenslets of {} x {} px, {} rows at once; {}\n{:<44}{:>8}{:>8}{:>8}\n",
      result.which.cols, result.which.rows, result.which.window_px, result.which.window_px,
      result.rows_at_once, result.same ? "the same bits both ways" : "THE RESULTS DIFFER", "us",
      "median", "p10", "p90");
  const auto line = [&](const char* name, const RoundTimes& times) {
    text += fmt::format("{:<44}{:>8.1f}{:>8.1f}{:>8.1f}\n", name, times.median_us, times.p10_us,
                        times.p90_us);
  };
  line("whole frame in to vortices", result.whole);
  line("last rows in to vortices, streamed", result.streamed);
  line("all work before the last rows", result.ahead);
  line("the most between two arrivals of rows", result.slowest);
  line("plain C by rows, whole frame", result.plain_rows);
  line("reading the frame", result.read);
  return text + fmt::format("{:<44}{:>8.2f}\n{:<44}{:>8.2f}\n", "streamed / whole",
                            result.streamed.median_us / result.whole.median_us,
                            "streamed / reading the frame",
                            result.streamed.median_us / result.read.median_us);
}

void bench_stream(const StreamBenchOptions& options) {
  const std::vector<BenchCase> all = options.size.window_cases();
  refuse_debug_build();
  const int rounds = options.rounds.count();
  nlohmann::ordered_json json = machine_json();
  json["rounds"] = rounds;
  std::string text =
      fmt::format("{}{} rounds, method circulation, one thread\n", machine_text(), rounds);
  Progress progress("cases", static_cast<std::int64_t>(all.size()));
  for (const BenchCase& which : all) {
    const StreamBenchmark result = time_stream(which, rounds);
    json["cases"].push_back(json_of(result));
    text += table(result);
    progress.step();
  }
  options.rounds.output.print(std::move(json), text);
}

}  // namespace

void add_bench_stream(CLI::App& bench) {
  auto options = std::make_shared<StreamBenchOptions>();
  CLI::App* stream = bench.add_subcommand(
      "stream",
      "Last row to vortices if the work follows the readout, beside whole frames; without sizes: "
      "40x40 lenslets of 6 px, 80x80 of 10, 30x30 of 32");
  options->size.add_windows_to(*stream);
  options->rounds.add_to(*stream);
  stream->callback([options] { bench_stream(*options); });
}

}  // namespace curlew
