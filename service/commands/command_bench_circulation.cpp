#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "service/bench/bench_options.h"
#include "service/bench/bench_run.h"
#include "service/bench/circulation_benchmark.h"
#include "service/commands/commands.h"
#include "service/results/latency_report.h"

namespace curlew {
namespace {

struct CirculationBenchOptions {
  BenchSize size;
  BenchRounds rounds{.rounds = 3000};  // of a few microseconds each
  std::vector<int> vortices{0, 8, 200};
};

nlohmann::ordered_json json_of(const CirculationBenchmark& result) {
  return {{"rows", result.rows},
          {"cols", result.cols},
          {"vortices", result.vortices},
          {"found", result.found},
          {"circulate", times_json(result.circulate)},
          {"find", times_json(result.find)},
          {"both", times_json(result.both)}};
}

std::string line(const CirculationBenchmark& result) {
  std::string text = fmt::format("{:>4} x {:<4}{:>9}{:>7}", result.cols, result.rows,
                                 result.vortices, result.found);
  for (const RoundTimes& times : {result.circulate, result.find, result.both})
    text += fmt::format("{:>20}", fmt::format("{:.2f} ({:.2f}-{:.2f})", times.median_us,
                                              times.p10_us, times.p90_us));
  return text + "\n";
}

void bench_circulation(const CirculationBenchOptions& options) {
  const std::vector<BenchCase> all = options.size.lenslet_cases({{16, 16, 0}, {80, 80, 0}});
  refuse_debug_build();
  const int rounds = options.rounds.count();
  nlohmann::ordered_json json = machine_json();
  json["rounds"] = rounds;
  std::string text;
  for (const BenchCase& which : all) {
    for (const int vortices : options.vortices) {
      const CirculationBenchmark result =
          time_circulation(which.rows, which.cols, vortices, rounds);
      json["cases"].push_back(json_of(result));
      text += line(result);
    }
  }
  options.rounds.output.print(
      std::move(json),
      fmt::format(
          "{}{} rounds: median (first to last tenth), us\n\n{:<11}{:>9}{:>7}{:>20}{:>20}{:>20}\n{}",
          machine_text(), rounds, "lenslets", "vortices", "found", "circulation", "finding", "both",
          text));
}

}  // namespace

void add_bench_circulation(CLI::App& bench) {
  auto options = std::make_shared<CirculationBenchOptions>();
  CLI::App* circulation = bench.add_subcommand(
      "circulation",
      "Slopes to vortices by circulation, by how many there are; without sizes: 16x16 and 80x80 "
      "lenslets");
  options->size.add_lenslets_to(*circulation);
  circulation->add_option("--vortices", options->vortices, "put into the frames")
      ->delimiter(',')
      ->check(CLI::Range(0, 10000))
      ->capture_default_str();
  options->rounds.add_to(*circulation);
  circulation->callback([options] { bench_circulation(*options); });
}

}  // namespace curlew
