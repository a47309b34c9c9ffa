#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>

#include "core/error.h"
#include "service/bench/bench_run.h"
#include "service/bench/false_alarm_benchmark.h"
#include "service/commands/commands.h"
#include "service/program/interrupt.h"
#include "service/program/progress.h"
#include "service/program/version.h"

namespace curlew {
namespace {

struct FalseAlarmOptionsOfBench {
  FalseAlarmOptions benchmark;
  bool quick = false;
  bool json = false;
};

void bench_false_alarms(FalseAlarmOptionsOfBench options) {
  refuse_debug_build();
  FalseAlarmOptions& benchmark = options.benchmark;
  if (options.quick) benchmark.frames = 1000;
  std::vector<FalseAlarmCount> counts;
  {
    Progress progress("frames",
                      benchmark.frames * static_cast<std::int64_t>(benchmark.photons.size()));
    counts = count_false_alarms(benchmark, [&] {
      progress.step();
      if (interrupted()) throw Failure("interrupted");
    });
  }
  if (options.json) {
    nlohmann::ordered_json json;
    json["program"] = kProgram;
    json["rows"] = benchmark.rows;
    json["cols"] = benchmark.cols;
    json["window_px"] = benchmark.window_px;
    json["frames"] = benchmark.frames;
    json["seed"] = benchmark.seed;
    json["interval"] = 0.95;
    for (const FalseAlarmCount& count : counts) {
      json["counts"].push_back({{"photons", count.photons},
                                {"rate", count.rate},
                                {"detector", count.detector},
                                {"lenslets", count.lenslets},
                                {"alarms", count.alarms},
                                {"ratio", count.ratio()},
                                {"low", count.ratio_low()},
                                {"high", count.ratio_high()}});
    }
    fmt::print("{}\n", json.dump(2));
    return;
  }
  fmt::print(
      "{}, {} build\n{} plane-wave frames a flux, {} x {} lenslets of {} px; false alarms over "
      "those stated,\nwith their 95 % Poisson interval. *_probable: those with a probability of .5 "
      "or more\n\n{:>8} {:>9} {:>6}  {:<20} {:>7} {:>6}  {}\n",
      kProgram, kBuildType, benchmark.frames, benchmark.cols, benchmark.rows, benchmark.window_px,
      "photons", "lenslets", "rate", "detector", "alarms", "ratio", "interval");
  for (const FalseAlarmCount& count : counts) {
    fmt::print("{:>8} {:>9.1f} {:>6}  {:<20} {:>7} {:>6.3f}  {:.3f} to {:.3f}\n", count.photons,
               count.lenslets, count.rate, count.detector, count.alarms, count.ratio(),
               count.ratio_low(), count.ratio_high());
  }
}

}  // namespace

void add_bench_false_alarms(CLI::App& bench) {
  auto options = std::make_shared<FalseAlarmOptionsOfBench>();
  FalseAlarmOptions& benchmark = options->benchmark;
  CLI::App* alarms = bench.add_subcommand(
      "false-alarms", "The rate of false alarms in slope noise against the stated one");
  alarms->add_option("--photons", benchmark.photons, "photons of each lenslet")
      ->delimiter(',')
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  alarms->add_option("--rates", benchmark.rates, "rates to state, in false alarms a frame")
      ->delimiter(',')
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  alarms->add_option("--frames", benchmark.frames, "frames at each flux")
      ->check(CLI::Range(1, 100000000))
      ->capture_default_str();
  alarms->add_option("--window", benchmark.window_px, "pixels per lenslet side")
      ->check(CLI::Range(4, 64))
      ->capture_default_str();
  alarms->add_option("--seed", benchmark.seed, "seed of the noise")->capture_default_str();
  alarms->add_flag("--quick", options->quick, "only 1000 frames, to show that all of it runs");
  alarms->add_flag("--json", options->json, "print JSON");
  alarms->callback([options] { bench_false_alarms(*options); });
}

}  // namespace curlew
