#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

#include "service/bench/bench_run.h"
#include "service/bench/bootstrap.h"
#include "service/bench/position_benchmark.h"
#include "service/commands/commands.h"
#include "service/program/version.h"
#include "service/results/json_float.h"
#include "service/results/truth_match.h"

namespace curlew {
namespace {

struct BoundOptionsOfBench {
  PositionBenchmarkOptions benchmark;
  BenchRun run;
};

template <typename Value>
Interval interval(const PositionCellResult& cell, Value value) {
  std::vector<double> values;
  for (const PositionScore& sample : cell.samples) values.push_back(value(sample));
  return interval_of(std::move(values));
}

template <typename Value>
nlohmann::ordered_json figure_json(const PositionCellResult& cell, Value value) {
  const Interval range = interval(cell, value);
  return {{"value", json_number(value(cell.score))},
          {"low", json_number(range.low)},
          {"high", json_number(range.high)}};
}

struct BoundMember {
  const char* name;
  double PositionScore::Bound::*value;
};
constexpr std::array<BoundMember, 5> kBoundMembers = {{
    {"hits", &PositionScore::Bound::hits},
    {"uncut", &PositionScore::Bound::uncut},
    {"median", &PositionScore::Bound::median},
    {"all", &PositionScore::Bound::all},
    {"within", &PositionScore::Bound::within},
}};

nlohmann::ordered_json cell_json(const PositionCellResult& cell) {
  nlohmann::ordered_json json;
  json["rytov_variance"] = cell.rytov_variance;
  json["photons"] = json_number(cell.photons);
  json["learnt_from"] = cell.learnt_from;
  json["mode_power"] = cell.mode_power;
  json["required"] = cell.score.vortices;
  json["hits"] = cell.score.hits;
  json["classifier"]["hits"] = figure_json(cell, [](const auto& s) { return s.rms; });
  json["classifier"]["median"] = figure_json(cell, [](const auto& s) { return s.median; });
  for (std::size_t b = 0; b < kBoundLenslets.size(); ++b) {
    nlohmann::ordered_json& bound =
        json[fmt::format("bound_{}x{}", kBoundLenslets[b], kBoundLenslets[b])];
    for (const BoundMember& member : kBoundMembers)
      bound[member.name] =
          figure_json(cell, [&](const auto& s) { return s.bounds[b].*member.value; });
  }
  for (const PositionClass& kind : cell.classes) {
    json["classes"].push_back({{"name", kind.name},
                               {"required", kind.score.vortices},
                               {"hits", kind.score.hits},
                               {"classifier", json_number(kind.score.rms)},
                               {"bound_4x4", json_number(kind.score.bounds[0].hits)},
                               {"bound_6x6", json_number(kind.score.bounds[1].hits)}});
  }
  for (const PositionVortex& vortex : cell.vortices) {
    json["vortices"].push_back(
        {{"field", vortex.field},
         {"x", vortex.truth.x},
         {"y", vortex.truth.y},
         {"charge", vortex.truth.charge},
         {"light", vortex.light},
         {"nearest", json_number(vortex.nearest)},
         {"error", vortex.hit ? json_number(vortex.error) : nlohmann::json(nullptr)},
         {"bound_4x4", std::sqrt(vortex.bounds[0].variance)},
         {"bound_6x6", std::sqrt(vortex.bounds[1].variance)}});
  }
  return json;
}

nlohmann::ordered_json results_json(const PositionBenchmarkOptions& options,
                                    const std::vector<PositionCellResult>& cells) {
  nlohmann::ordered_json json;
  json["program"] = kProgram;
  json["lenslet"] = options.field.lenslet;
  json["test_realisations"] = options.test_realisations;
  json["validation_realisations"] = options.validation_realisations;
  json["training_realisations"] = options.training_realisations;
  json["modes"] = options.modes;
  json["hit_radius"] = kHitRadius;
  json["interval"] = 0.95;
  for (const PositionCellResult& cell : cells) json["cells"].push_back(cell_json(cell));
  return json;
}

template <typename Value>
std::string figure(const PositionCellResult& cell, Value value) {
  if (!std::isfinite(value(cell.score))) return "–";
  const Interval range = interval(cell, value);
  return fmt::format("{:.3f} ± {:.2f}", value(cell.score), 0.5 * (range.high - range.low));
}

std::string table(const PositionCellResult& cell, int fields) {
  std::string text = fmt::format(
      "\nRytov variance {}, {}: {} vortices in {} fields, {} hit; modes learnt from {} others hold "
      "{:.2f} % of the light\n{:<22}",
      cell.rytov_variance,
      std::isfinite(cell.photons) ? fmt::format("{} photons", cell.photons) : "no noise",
      cell.score.vortices, fields, cell.score.hits, cell.learnt_from, 100.0 * cell.mode_power, "");
  for (const char* heading : {"hits", "median", "uncut", "all", "within"})
    text += fmt::format(" {:>12}", heading);
  text += fmt::format("\n{:<22} {:>12} {:>12}\n", "classifier",
                      figure(cell, [](const auto& s) { return s.rms; }),
                      figure(cell, [](const auto& s) { return s.median; }));
  for (std::size_t b = 0; b < kBoundLenslets.size(); ++b) {
    text += fmt::format("{:<22}",
                        fmt::format("bound, {}x{} lenslets", kBoundLenslets[b], kBoundLenslets[b]));
    using Bound = PositionScore::Bound;
    for (double Bound::*value :
         {&Bound::hits, &Bound::median, &Bound::uncut, &Bound::all, &Bound::within})
      text +=
          fmt::format(" {:>12}", figure(cell, [&](const auto& s) { return s.bounds[b].*value; }));
    text += '\n';
  }
  text += fmt::format("{:<22} {:>12} {:>12} {:>12} {:>12}\n", "  of these", "vortices", "hit",
                      "classifier", "bound, 6x6");
  for (const PositionClass& kind : cell.classes) {
    const auto rms = [](double value) {
      return std::isfinite(value) ? fmt::format("{:.3f}", value) : std::string("–");
    };
    text += fmt::format("{:<22} {:>12} {:>12} {:>12} {:>12}\n", kind.name, kind.score.vortices,
                        kind.score.hits, rms(kind.score.rms), rms(kind.score.bounds[1].hits));
  }
  return text;
}

void bench_bound(BoundOptionsOfBench options) {
  refuse_debug_build();
  PositionBenchmarkOptions& benchmark = options.benchmark;
  if (options.run.quick) {
    benchmark.test_realisations = benchmark.validation_realisations = 4;
    benchmark.training_realisations = 6;
    benchmark.polynomials = 12;
    benchmark.modes = 60;
  }
  for (double& photons : benchmark.photons) {
    if (photons == 0.0) photons = kWithoutNoise;
  }
  const RealisationCache cache(options.run.folder());
  const auto n = static_cast<std::int64_t>(benchmark.rytov_variances.size()) *
                 (benchmark.training_realisations + benchmark.validation_realisations +
                  2 * benchmark.test_realisations);
  const std::vector<PositionCellResult> cells = options.run.watch(
      "fields", n, [&](auto step) { return run_position_benchmark(benchmark, cache, step); });
  if (options.run.json) {
    fmt::print("{}\n", results_json(benchmark, cells).dump(2));
    return;
  }
  fmt::print(
      "{}, {} build, {} test fields a cell\nError of position in pitches, beside what the spots "
      "allow at best.\nhits: rms of the vortices that the classifier hits, errors over {} cut off "
      "for the bound as for it; median: of its errors,\nand of the bound's rms of single "
      "vortices; uncut: the bound where no error is cut off; all: of all vortices, errors within "
      "{};\nwithin: how many of them are; ± half of the 95 % interval\n",
      kProgram, kBuildType, benchmark.test_realisations, kHitRadius, kHitRadius);
  for (const PositionCellResult& cell : cells)
    fmt::print("{}", table(cell, benchmark.test_realisations));
}

}  // namespace

void add_bench_bound(CLI::App& bench) {
  auto options = std::make_shared<BoundOptionsOfBench>();
  PositionBenchmarkOptions& benchmark = options->benchmark;
  CLI::App* bound = bench.add_subcommand(
      "bound", "How well the spots tell a vortex's place at best, beside the classifier");
  bound->add_option("--realisations", benchmark.test_realisations, "test fields of each cell")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  bound
      ->add_option("--validation", benchmark.validation_realisations,
                   "fields of each cell on which the classifier's threshold is chosen")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  bound
      ->add_option("--training", benchmark.training_realisations,
                   "fields of each turbulence from which the modes are learnt")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  bound
      ->add_option("--modes", benchmark.modes,
                   "number of complex modes of the field over 6 x 6 lenslets")
      ->check(CLI::Range(1, 2000))
      ->capture_default_str();
  bound
      ->add_option("--polynomials", benchmark.polynomials,
                   "polynomials along each axis of which modes are made")
      ->check(CLI::Range(2, 48))
      ->capture_default_str();
  bound->add_option("--rytov", benchmark.rytov_variances, "Rytov variances")
      ->delimiter(',')
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  bound->add_option("--photons", benchmark.photons, "photons of each lenslet; 0: no noise")
      ->delimiter(',')
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  bound->add_option("--lenslet", benchmark.field.lenslet, "side of a lenslet, √(λL)")
      ->capture_default_str();
  options->run.add_to(*bound, "only 4 fields of each kind, to show that all of it runs",
                      benchmark.threads);
  bound->callback([options] { bench_bound(*options); });
}

}  // namespace curlew
