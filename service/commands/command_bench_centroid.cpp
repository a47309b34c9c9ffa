#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "service/bench/bench_options.h"
#include "service/bench/bench_run.h"
#include "service/bench/centroid_benchmark.h"
#include "service/commands/commands.h"
#include "service/program/progress.h"
#include "service/results/latency_report.h"

namespace curlew {
namespace {

struct CentroidBenchOptions {
  BenchSize size;
  BenchRounds rounds;
  bool methods = false;
};

constexpr std::array<PixelType, 2> kPixelTypes = {PixelType::kU16, PixelType::kU8};

const char* name_of(PixelType type) { return type == PixelType::kU8 ? "u8" : "u16"; }

double ratio(const RoundTimes& a, const RoundTimes& b) { return a.median_us / b.median_us; }

nlohmann::ordered_json json_of(const CentroidTimes& times) {
  return {{"curlew", times_json(times.curlew)},
          {"following", times_json(times.following)},
          {"kernel", times_json(times.kernel)},
          {"kernel_by_windows", times_json(times.kernel_by_windows)},
          {"kernel_tilted", times_json(times.kernel_tilted)},
          {"kernel_without_maps", times_json(times.kernel_without_maps)},
          {"plain_windows", times_json(times.plain_windows)},
          {"plain_rows", times_json(times.plain_rows)},
          {"read", times_json(times.read)},
          {"curlew_over_plain_windows", ratio(times.curlew, times.plain_windows)},
          {"curlew_over_plain_rows", ratio(times.curlew, times.plain_rows)},
          {"curlew_over_read", ratio(times.curlew, times.read)},
          {"curlew_over_kernel", ratio(times.curlew, times.kernel)},
          {"kernel_over_by_windows", ratio(times.kernel, times.kernel_by_windows)},
          {"kernel_over_plain_windows", ratio(times.kernel, times.plain_windows)},
          {"kernel_over_plain_rows", ratio(times.kernel, times.plain_rows)},
          {"kernel_over_read", ratio(times.kernel, times.read)}};
}

nlohmann::ordered_json json_of(const BenchCase& which) {
  return {{"rows", which.rows}, {"cols", which.cols}, {"window_px", which.window_px}};
}

nlohmann::ordered_json json_of(const CentroidBenchmark& result) {
  nlohmann::ordered_json json = json_of(result.which);
  json["pixels"] = name_of(result.pixel_type);
  json["frame_bytes"] = result.frame_bytes;
  json["build"] = {{"plain_windows", name_of(result.windows_build)},
                   {"plain_rows", name_of(result.rows_build)},
                   {"read", name_of(result.read_build)}};
  json["warm"] = json_of(result.warm);
  json["cold"] = json_of(result.cold);
  json["cold_frames"] = result.cold_frames;
  return json;
}

std::string title(const BenchCase& which) {
  return fmt::format("{} x {} lenslets of {} x {} px", which.cols, which.rows, which.window_px,
                     which.window_px);
}

std::string table(const CentroidBenchmark& result) {
  const CentroidTimes& warm = result.warm;
  const CentroidTimes& cold = result.cold;
  std::string text = fmt::format("\n{}, {}\n{:<31}{:^24}  {:^24}\n{:<31}", title(result.which),
                                 name_of(result.pixel_type), "", "the same frame again",
                                 fmt::format("{} frames in turn", result.cold_frames), "us");
  for (int i = 0; i < 2; ++i)
    text += fmt::format("{:>8}{:>8}{:>8}{}", "median", "p10", "p90", i == 0 ? "  " : "\n");
  const auto add = [&](const std::string& name, RoundTimes CentroidTimes::*of) {
    const RoundTimes& a = warm.*of;
    const RoundTimes& b = cold.*of;
    text += fmt::format("{:<31}{:>8.1f}{:>8.1f}{:>8.1f}  {:>8.1f}{:>8.1f}{:>8.1f}\n", name,
                        a.median_us, a.p10_us, a.p90_us, b.median_us, b.p10_us, b.p90_us);
  };
  add("curlew", &CentroidTimes::curlew);
  add("curlew, windows follow", &CentroidTimes::following);
  add("kernel alone", &CentroidTimes::kernel);
  add("kernel, window by window", &CentroidTimes::kernel_by_windows);
  add("kernel, tilted by 1 degree", &CentroidTimes::kernel_tilted);
  add("kernel alone, without maps", &CentroidTimes::kernel_without_maps);
  add(fmt::format("plain C by windows, {}", name_of(result.windows_build)),
      &CentroidTimes::plain_windows);
  add(fmt::format("plain C by rows, {}", name_of(result.rows_build)), &CentroidTimes::plain_rows);
  add(fmt::format("reading the frame, {}", name_of(result.read_build)), &CentroidTimes::read);
  const auto add_ratios = [&](const char* name, RoundTimes CentroidTimes::*of) {
    for (const auto& [what, ours] :
         {std::pair{"curlew", &CentroidTimes::curlew}, {"kernel", &CentroidTimes::kernel}}) {
      text += fmt::format("{:<31}{:>8.2f}{:>18}{:>8.2f}\n", fmt::format("{} / {}", what, name),
                          ratio(warm.*ours, warm.*of), "", ratio(cold.*ours, cold.*of));
    }
  };
  add_ratios("plain C by windows", &CentroidTimes::plain_windows);
  add_ratios("plain C by rows", &CentroidTimes::plain_rows);
  add_ratios("reading the frame", &CentroidTimes::read);
  return text;
}

/// Times the methods in one case, adds an entry to `cases` and returns a table.
std::string bench_methods(const BenchCase& which, int rounds, nlohmann::ordered_json& cases) {
  std::string text = fmt::format("\n{}, u16, without maps\n{:<20}{:>10}{:>10}{:>10}{:>15}\n",
                                 title(which), "us", "median", "p10", "p90", "/ thresholded");
  nlohmann::ordered_json entry = json_of(which);
  const std::vector<CentroidMethodTimes> methods = time_centroid_methods(which, rounds);
  for (const auto& [name, times] : methods) {
    const double to_first = ratio(times, methods.front().times);
    entry["methods"][name] = times_json(times);
    entry["methods"][name]["over_thresholded"] = to_first;
    text += fmt::format("{:<20}{:>10.1f}{:>10.1f}{:>10.1f}{:>15.2f}\n", name, times.median_us,
                        times.p10_us, times.p90_us, to_first);
  }
  cases.push_back(entry);
  return text;
}

void bench_centroid(const CentroidBenchOptions& options) {
  const std::vector<BenchCase> all = options.size.window_cases();
  refuse_debug_build();
  const int rounds = options.rounds.count();
  nlohmann::ordered_json json = machine_json();
  json["rounds"] = rounds;
  std::string text;
  const std::size_t cases = all.size() * (options.methods ? 1 : kPixelTypes.size());
  Progress progress("cases", static_cast<std::int64_t>(cases));
  for (const BenchCase& which : all) {
    if (options.methods) {
      text += bench_methods(which, rounds, json["cases"]);
      progress.step();
      continue;
    }
    for (const PixelType type : kPixelTypes) {
      const CentroidBenchmark result = time_centroids(which, type, rounds);
      json["cases"].push_back(json_of(result));
      text += table(result);
      progress.step();
    }
  }
  options.rounds.output.print(
      std::move(json),
      fmt::format("{}{} rounds{}\n{}", machine_text(), rounds,
                  options.methods
                      ? ""
                      : ". curlew: the whole stage with windows that stay; plain C: flux "
                        "and first moments only, "
                        "by windows or, which windows in a grid allow, by whole rows",
                  text));
}

}  // namespace

void add_bench_centroid(CLI::App& bench) {
  auto options = std::make_shared<CentroidBenchOptions>();
  CLI::App* centroid = bench.add_subcommand(
      "centroid",
      "Pixels to centroids beside plain C and a read of the frame; without sizes: 40x40 lenslets "
      "of 6 px, 80x80 of 10, 30x30 of 32");
  options->size.add_windows_to(*centroid);
  options->rounds.add_to(*centroid);
  centroid->add_flag("--methods", options->methods,
                     "the methods of centroids beside each other instead");
  centroid->callback([options] { bench_centroid(*options); });
}

}  // namespace curlew
