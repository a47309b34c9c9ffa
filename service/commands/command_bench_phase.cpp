#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <utility>

#include "core/error.h"
#include "service/bench/bench_run.h"
#include "service/bench/phase_benchmark.h"
#include "service/commands/commands.h"
#include "service/program/version.h"
#include "service/results/json_float.h"

namespace curlew {
namespace {

struct PhaseOptionsOfBench {
  PhaseBenchmarkOptions benchmark;
  BenchRun run;
  bool validation = false;
};

// Lenslets a side, vortices.
constexpr std::array<std::pair<int, int>, 2> kTimed = {{{16, 6}, {80, 60}}};

nlohmann::ordered_json interval_json(const MeanWithInterval& mean) {
  return {{"value", mean.value}, {"low", mean.interval.low}, {"high", mean.interval.high}};
}

nlohmann::ordered_json results_json(const PhaseOptionsOfBench& options,
                                    const std::vector<PhaseCellResult>& cells,
                                    const std::vector<PhaseTiming>& timings) {
  nlohmann::ordered_json json;
  json["program"] = kProgram;
  json["subset"] = options.validation ? "validation" : "test";
  json["realisations"] = options.benchmark.realisations;
  json["lenslet"] = options.benchmark.field.lenslet;
  json["interval"] = 0.95;
  for (const PhaseCellResult& cell : cells) {
    nlohmann::ordered_json entry;
    entry["rytov_variance"] = cell.rytov_variance;
    entry["photons"] = json_number(cell.photons);
    entry["vortices"] = cell.true_vortices;
    entry["baseline"] = cell.baseline;
    for (const PhaseRowResult& row : cell.rows) {
      entry["rows"].push_back({{"name", row.name},
                               {"method", row.method},
                               {"strehl", interval_json(row.strehl)},
                               {"gain", interval_json(row.gain)},
                               {"mirror_strehl", interval_json(row.mirror)},
                               {"vortices", row.vortices}});
    }
    json["cells"].push_back(entry);
  }
  for (const PhaseTiming& timing : timings) {
    json["timing"].push_back({{"lenslets", timing.size},
                              {"vortices", timing.vortices},
                              {"median_us", timing.whole_us},
                              {"least_us", timing.min_us},
                              {"choice_us", timing.choice_us},
                              {"field_us", timing.field_us},
                              {"cuts_us", timing.cuts_us},
                              {"split_us", timing.split_us}});
  }
  return json;
}

std::string table(const PhaseCellResult& cell) {
  std::string text = fmt::format(
      "\nRytov variance {}, {}: {:.1f} vortices a frame; gain over {}\n{:<19} {:>6} {:>15} {:>24} "
      "{:>7} {:>8}\n",
      cell.rytov_variance,
      std::isfinite(cell.photons) ? fmt::format("{} photons", cell.photons) : "no noise",
      cell.true_vortices, cell.baseline, "", "Strehl", "95 %", "gain, 95 %", "mirror", "vortices");
  for (const PhaseRowResult& row : cell.rows) {
    text += fmt::format(
        "{:<19} {:>6.3f}   {:.3f} to {:.3f}   {:+.3f}, {:+.3f} to {:+.3f} {:>7.3f} "
        "{:>8.1f}\n",
        row.name, row.strehl.value, row.strehl.interval.low, row.strehl.interval.high,
        row.gain.value, row.gain.interval.low, row.gain.interval.high, row.mirror.value,
        row.vortices);
  }
  return text;
}

void bench_phase(PhaseOptionsOfBench options) {
  refuse_debug_build();
  PhaseBenchmarkOptions& benchmark = options.benchmark;
  if (options.run.quick) benchmark.realisations = 4;
  if (options.validation) benchmark.subset = Subset::kValidation;
  for (double& photons : benchmark.photons) {
    if (photons == 0.0) photons = kWithoutNoise;
  }
  const RealisationCache realisations(options.run.folder());
  const PhaseFieldCache fields(options.run.folder());
  const auto n =
      static_cast<std::int64_t>(benchmark.rytov_variances.size()) * benchmark.realisations;
  const std::vector<PhaseCellResult> cells = options.run.watch("fields", n, [&](auto step) {
    return run_phase_benchmark(benchmark, realisations, fields, step);
  });
  std::vector<PhaseTiming> timings;
  timings.reserve(kTimed.size());
  for (const auto& [size, vortices] : kTimed)
    timings.push_back(time_hidden_phase(size, vortices, options.run.quick ? 20 : 400));
  if (options.run.json) {
    fmt::print("{}\n", results_json(options, cells, timings).dump(2));
    return;
  }
  fmt::print(
      "{}, {} build, {} {} fields a cell\nMean Strehl ratio after ideal correction; its gain over "
      "the better of both least squares, by frame; after a mirror that cannot jump\n",
      kProgram, kBuildType, benchmark.realisations, options.validation ? "validation" : "test");
  for (const PhaseCellResult& cell : cells) fmt::print("{}", table(cell));
  fmt::print("\n");
  for (const PhaseRowResult& row : cells.front().rows)
    fmt::print("{:<19} {}\n", row.name, row.method);
  fmt::print("\nhidden phase of a frame, one thread, µs\n");
  for (const PhaseTiming& t : timings) {
    fmt::print(
        "{:>3} x {:<3} {:>3} vortices: median {:.0f}, least {:.0f} (choice {:.0f}, vortices' field "
        "{:.0f}, cuts {:.0f}, least squares {:.0f})\n",
        t.size, t.size, t.vortices, t.whole_us, t.min_us, t.choice_us, t.field_us, t.cuts_us,
        t.split_us);
  }
}

}  // namespace

void add_bench_phase(CLI::App& bench) {
  auto options = std::make_shared<PhaseOptionsOfBench>();
  PhaseBenchmarkOptions& benchmark = options->benchmark;
  CLI::App* phase = bench.add_subcommand(
      "phase", "Strehl with the hidden phase against least squares; goes on where it ended");
  phase->add_option("--realisations", benchmark.realisations, "fields of each cell")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  phase->add_flag("--validation", options->validation,
                  "use the fields on which everything was tuned, not the test fields");
  phase->add_option("--rytov", benchmark.rytov_variances, "Rytov variances")
      ->delimiter(',')
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  phase->add_option("--photons", benchmark.photons, "photons of each lenslet; 0: no noise")
      ->delimiter(',')
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  phase->add_option("--lenslet", benchmark.field.lenslet, "side of a lenslet, √(λL)")
      ->capture_default_str();
  options->run.add_to(*phase, "only 4 fields, to show that all of it runs", benchmark.threads);
  phase->callback([options] { bench_phase(*options); });
}

}  // namespace curlew
