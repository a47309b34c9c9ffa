#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "core/error.h"
#include "service/bench/bench_options.h"
#include "service/bench/bench_run.h"
#include "service/bench/latency_benchmark.h"
#include "service/commands/commands.h"
#include "service/program/progress.h"
#include "service/results/latency_report.h"

namespace curlew {
namespace {

struct LatencyBenchOptions {
  BenchSize size;
  std::int64_t frames = 0;  ///< 0: what suits the cases
  std::string method = "circulation";
  std::string threads = "inline";
  std::vector<int> cpus;
  double pace_hz = 0.0;
  bool scaling = false;
  BenchOutput output;
};

nlohmann::ordered_json json_of(const LatencyTimes& times) {
  nlohmann::ordered_json json;
  for (std::size_t stage = 0; stage < kStageCount; ++stage)
    json[kStages[stage].name] = times_json(times.stage[stage]);
  json["total"] = times_json(times.total);
  json["plain_rows"] = times_json(times.plain_rows);
  json["read"] = times_json(times.read);
  return json;
}

/// Returns ns a lenslet, of the columns of the scaling table.
std::vector<std::pair<const char*, double>> ns_per_lenslet(const LatencyBenchmark& result) {
  const double ns = 1e3 / (1.0 * result.which.rows * result.which.cols);
  const LatencyTimes& times = result.warm;
  std::vector<std::pair<const char*, double>> columns{{"read", ns * times.read.median_us},
                                                      {"plain C", ns * times.plain_rows.median_us}};
  for (std::size_t stage = 0; stage < kStageCount; ++stage)
    if (ns * times.stage[stage].median_us >= 0.1)
      columns.emplace_back(kStages[stage].name, ns * times.stage[stage].median_us);
  columns.emplace_back("total", ns * times.total.median_us);
  columns.emplace_back("total, cold", ns * result.cold.total.median_us);
  return columns;
}

double frames_a_second(const RunReport& report) {
  return static_cast<double>(report.frames) / report.seconds;
}

nlohmann::ordered_json json_of(const LatencyBenchmark& result) {
  nlohmann::ordered_json json = {{"rows", result.which.rows},
                                 {"cols", result.which.cols},
                                 {"window_px", result.which.window_px},
                                 {"frames_a_second", frames_a_second(result.report)},
                                 {"latency_us", latency_json(result.report)},
                                 {"warm", json_of(result.warm)},
                                 {"cold", json_of(result.cold)}};
  for (const auto& [name, ns] : ns_per_lenslet(result)) json["ns_per_lenslet"][name] = ns;
  return json;
}

std::string table(const LatencyBenchmark& result) {
  const BenchCase& which = result.which;
  std::string text =
      fmt::format("\n{} x {} lenslets of {} x {} px, u16, dark, flat and bad pixels, {} frames\n{}",
                  which.cols, which.rows, which.window_px, which.window_px, result.report.frames,
                  latency_table(result.report));
  const auto line = [&](const char* name, const LatencyTimes& times) {
    text += fmt::format(
        "{:<42}{:>8.1f}; a read of the frame {:.1f} (total / read {:.1f}), plain C by rows "
        "{:.1f}\n",
        name, times.total.median_us, times.read.median_us,
        times.total.median_us / times.read.median_us, times.plain_rows.median_us);
  };
  line("total, median", result.warm);
  line("total, median, caches swept between frames", result.cold);
  text += fmt::format("{:.0f} frames a second\n", frames_a_second(result.report));
  if (const std::string followed = followed_text(result.report); !followed.empty())
    text += followed + "\n";
  return text;
}

/// Returns ns a lenslet by stage for all sizes, and by how much the largest of a column exceeds the
/// smallest.
std::string scaling_table(const std::vector<LatencyBenchmark>& results) {
  std::string text = fmt::format("\n{:<12}", "ns/lenslet");
  const auto columns = ns_per_lenslet(results.back());
  std::vector<double> least(columns.size(), INFINITY);
  std::vector<double> most(columns.size(), 0.0);
  for (const auto& [name, ns] : columns) text += fmt::format("{:>12}", name);
  text += '\n';
  for (const LatencyBenchmark& result : results) {
    text += fmt::format("{:<12}", fmt::format("{} x {}", result.which.cols, result.which.rows));
    const auto row = ns_per_lenslet(result);
    for (std::size_t i = 0; i < columns.size(); ++i) {
      const auto at = std::find_if(row.begin(), row.end(), [&](const auto& column) {
        return std::string(column.first) == columns[i].first;
      });
      const double ns = at != row.end() ? at->second : 0.0;
      least[i] = std::min(least[i], ns);
      most[i] = std::max(most[i], ns);
      text += fmt::format("{:>12.2f}", ns);
    }
    text += '\n';
  }
  text += fmt::format("{:<12}", "most / least");
  for (std::size_t i = 0; i < columns.size(); ++i)
    text += fmt::format("{:>12.2f}", most[i] / least[i]);
  return text + '\n';
}

void bench_latency(const LatencyBenchOptions& options) {
  constexpr std::int64_t kFrames = 2000;
  constexpr std::int64_t kScalingFrames = 300;
  constexpr int kScalingWindow = 10;
  if (options.frames < 0) throw UsageError("--frames must be at least 1");
  const BenchCase& one = options.size.one;
  if (options.scaling && (one.rows != 0 || one.cols != 0))
    throw UsageError("--scaling has sizes of its own: leave out --rows and --cols");
  const std::vector<BenchCase> cases =
      options.scaling ? scaling_cases(one.window_px != 0 ? one.window_px : kScalingWindow)
                      : options.size.window_cases();
  refuse_debug_build();
  LatencyOptions run{.frames = options.frames,
                     .method = setting_from<DetectMethod>(options.method, "--method"),
                     .threads = setting_from<Threading>(options.threads, "--threads"),
                     .cpus = options.cpus,
                     .pace_hz = options.pace_hz};
  if (run.frames == 0) run.frames = options.scaling ? kScalingFrames : kFrames;
  Progress progress("bench", frames_of_case(run) * static_cast<std::int64_t>(cases.size()));
  std::string pinning;
  const auto step = [&](std::int64_t frames) {
    for (std::int64_t i = 0; i < frames; ++i) progress.step();
  };
  const std::vector<LatencyBenchmark> results = time_latency(cases, run, step, pinning);
  nlohmann::ordered_json json = machine_json();
  json["threads"] = options.threads;
  json["method"] = options.method;
  json["frames"] = run.frames;
  json["pinning"] = pinning;
  json["pace_hz"] = run.pace_hz;
  std::string text = fmt::format("{}method {}, threads {}, pinned: {}\n", machine_text(),
                                 options.method, options.threads, pinning);
  for (const LatencyBenchmark& result : results) {
    json["cases"].push_back(json_of(result));
    if (!options.scaling) text += table(result);
  }
  if (options.scaling) text += scaling_table(results);
  options.output.print(std::move(json), text);
}

}  // namespace

void add_bench_latency(CLI::App& bench) {
  auto options = std::make_shared<LatencyBenchOptions>();
  CLI::App* latency = bench.add_subcommand(
      "latency", "Latency of every stage; without sizes: 40x40 of 6 px, 80x80 of 10, 30x30 of 32");
  options->size.add_windows_to(*latency);
  latency->add_flag("--scaling", options->scaling,
                    "nanoseconds a lenslet by stage, from 10x10 to 200x200 lenslets");
  latency->add_option("--frames", options->frames,
                      "frames of each case; without it 2000, and 300 with --scaling");
  latency
      ->add_option("--method", options->method,
                   "how vortices are looked for; the default is what older figures are of")
      ->capture_default_str();
  latency
      ->add_option("--threads", options->threads,
                   "all stages on one thread (inline) or shared by a team of them (team)")
      ->capture_default_str();
  latency->add_option("--cpus", options->cpus, "CPUs that the threads are pinned to, in turn")
      ->delimiter(',');
  latency
      ->add_option("--pace-hz", options->pace_hz,
                   "warm frames come at this rate; without it each as soon as it is taken")
      ->check(CLI::PositiveNumber);
  options->output.add_to(*latency);
  latency->callback([options] { bench_latency(*options); });
}

}  // namespace curlew
