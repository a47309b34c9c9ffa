#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <cstdint>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "service/bench/bench_options.h"
#include "service/bench/bench_run.h"
#include "service/bench/split_benchmark.h"
#include "service/commands/commands.h"
#include "service/program/progress.h"
#include "service/results/latency_report.h"

namespace curlew {
namespace {

struct SplitBenchOptions {
  BenchSize size;
  BenchRounds rounds;
};

nlohmann::ordered_json json_of(const SplitTimes& times) {
  nlohmann::ordered_json json = {
      {"name", name_of(times.disturbance)},
      {"warm", times_json(times.warm)},
      {"cold", times_json(times.cold)},
      {"plain_float", times_json(times.plain_float)},
      {"plain_double", times_json(times.plain_double)},
      {"read", times_json(times.read)},
      {"curlew_over_plain_float", times.cold.median_us / times.plain_float.median_us},
      {"curlew_over_plain_double", times.cold.median_us / times.plain_double.median_us},
      {"iterations", times.iterations},
      {"converged", times.converged},
      {"worst_error", times.worst_error},
      {"plain_float_error", times.plain_float_error}};
  if (times.disturbance == SplitDisturbance::kNone) {
    json["plain_kept"] = times_json(times.plain_kept);
    json["curlew_over_plain_kept"] = times.cold.median_us / times.plain_kept.median_us;
  }
  return json;
}

nlohmann::ordered_json json_of(const SplitBenchmark& result) {
  nlohmann::ordered_json json = {
      {"rows", result.rows}, {"cols", result.cols}, {"lit", result.lit}, {"frames", result.frames}};
  for (const SplitTimes& times : result.times) json["splits"].push_back(json_of(times));
  return json;
}

std::string spread(const RoundTimes& times) {
  const int digits = times.median_us < 100.0 ? 1 : 0;
  return fmt::format("{:.{}f} ({:.{}f}-{:.{}f})", times.median_us, digits, times.p10_us, digits,
                     times.p90_us, digits);
}

std::string table(const SplitBenchmark& result) {
  std::string text = fmt::format("\n{} x {} lenslets, {} lit, {} frames in turn\n", result.cols,
                                 result.rows, result.lit, result.frames);
  text +=
      fmt::format("{:<19}{:>18}{:>18}{:>20}{:>20}{:>9}{:>7}{:>10}{:>14}\n", "us", "warm", "cold",
                  "Eigen, float", "Eigen, double", "/ Eigen", "steps", "error", "Eigen, float");
  for (const SplitTimes& times : result.times) {
    text += fmt::format("{:<19}{:>18}{:>18}{:>20}{:>20}{:>9.2f}{:>7}{:>10.1e}{:>14.1e}{}\n",
                        name_of(times.disturbance), spread(times.warm), spread(times.cold),
                        spread(times.plain_float), spread(times.plain_double),
                        times.cold.median_us / times.plain_double.median_us, times.iterations,
                        times.worst_error, times.plain_float_error,
                        times.converged ? "" : "  not converged");
  }
  text += fmt::format(
      "none_faded by Eigen with one factor for all frames, float: {}; reading a frame of 10 x 10 "
      "px "
      "a lenslet: {}\n",
      spread(result.times.front().plain_kept), spread(result.times.front().read));
  return text;
}

void bench_split(const SplitBenchOptions& options) {
  const std::vector<BenchCase> all = options.size.lenslet_cases({{40, 40, 0}, {80, 80, 0}});
  refuse_debug_build();
  const int rounds = options.rounds.count();
  nlohmann::ordered_json json = machine_json();
  json["rounds"] = rounds;
  std::string text;
  Progress progress("cases", static_cast<std::int64_t>(all.size() * kSplitDisturbances.size()));
  for (const BenchCase& which : all) {
    const SplitBenchmark result =
        time_splits(which.rows, which.cols, rounds, [&] { progress.step(); });
    json["cases"].push_back(json_of(result));
    text += table(result);
  }
  options.rounds.output.print(std::move(json),
                              fmt::format("{}{} rounds: median (first to last tenth). Eigen: "
                                          "SimplicialLLT, factorised anew for each "
                                          "frame;\n/ Eigen: cold over double. error: of the worst "
                                          "curl-free slope against a refined "
                                          "solution in double, over the frame's largest slope\n{}",
                                          machine_text(), rounds, text));
}

}  // namespace

void add_bench_split(CLI::App& bench) {
  auto options = std::make_shared<SplitBenchOptions>();
  CLI::App* split = bench.add_subcommand(
      "split",
      "The least-squares split by faded lenslets and weights, beside Eigen's sparse Cholesky, and "
      "its errors; without sizes: 40x40 and 80x80 lenslets");
  options->size.add_lenslets_to(*split);
  options->rounds.add_to(*split);
  split->callback([options] { bench_split(*options); });
}

}  // namespace curlew
