#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "core/error.h"
#include "service/bench/bench_run.h"
#include "service/bench/tracking_benchmark.h"
#include "service/commands/commands.h"
#include "service/program/version.h"
#include "service/results/json_float.h"

namespace curlew {
namespace {

struct TrackOptionsOfBench {
  TrackingBenchmarkOptions benchmark;
  std::vector<double> wind;  // x, y of the first screen, … x, y of the last; empty: the default
  BenchRun run;
};

/// Returns the interval of one figure over n samples. `of` gives the figure of sample i, which may
/// be the difference of two rows.
template <typename Of>
Interval interval_of_samples(std::size_t n, Of of) {
  std::vector<double> samples;
  for (std::size_t i = 0; i < n; ++i) samples.push_back(of(i));
  return interval_of(std::move(samples));
}

struct Figure {
  double value;
  Interval interval;
};

Figure figure(const TrackingRow& row, const TrackingFigure& which) {
  return {which.value(row.figures), interval_of_samples(row.samples.size(), [&](std::size_t i) {
            return which.value(row.samples[i]);
          })};
}

/// Returns the tracked figure minus the one frame by frame, both of the same blocks of frames.
Figure difference(const TrackingCell& cell, const TrackingFigure& which) {
  return {which.value(cell.tracked.figures) - which.value(cell.frame_by_frame.figures),
          interval_of_samples(cell.tracked.samples.size(), [&](std::size_t i) {
            return which.value(cell.tracked.samples[i]) -
                   which.value(cell.frame_by_frame.samples[i]);
          })};
}

bool is_better(const Figure& change, bool less_is_better) {
  return less_is_better ? change.interval.high < 0.0 : change.interval.low > 0.0;
}

nlohmann::ordered_json json_of(const Figure& f) {
  return {{"value", json_number(f.value)},
          {"low", json_number(f.interval.low)},
          {"high", json_number(f.interval.high)}};
}

nlohmann::ordered_json results_json(const TrackingBenchmarkOptions& options,
                                    const std::vector<TrackingCell>& cells) {
  nlohmann::ordered_json json;
  json["program"] = kProgram;
  json["rytov_variance"] = options.sequence.field.rytov_variance;
  json["frames"] = options.frames;
  json["arrays"] = options.test_fields * options.sequence.arrays * options.sequence.arrays;
  for (const Wind& wind : options.sequence.wind) json["wind"].push_back({wind.x, wind.y});
  json["interval"] = 0.95;
  for (const TrackingCell& cell : cells) {
    nlohmann::ordered_json entry;
    entry["photons"] = cell.photons;
    entry["required"] = cell.tracked.figures.counts.required;
    entry["threshold"] = json_number(cell.threshold);
    entry["least_probability"] = cell.min_probability;
    entry["tracker_us"] = cell.tracker_us;
    for (const TrackingFigure& which : kTrackingFigures) {
      const Figure change = difference(cell, which);
      entry[std::string(which.name)] = {
          {"frame_by_frame", json_of(figure(cell.frame_by_frame, which))},
          {"tracked", json_of(figure(cell.tracked, which))},
          {"difference", json_of(change)},
          {"better", is_better(change, which.less_is_better)}};
    }
    json["cells"].push_back(entry);
  }
  return json;
}

std::string text_of(const Figure& f) {
  return fmt::format("{:.4f} ± {:.4f}", f.value, 0.5 * (f.interval.high - f.interval.low));
}

std::string table(const TrackingCell& cell) {
  const TrackingCounts& counts = cell.tracked.figures.counts;
  std::string text = fmt::format(
      "\n{} photons: {:.0f} vortices in {:.0f} frames; frame by frame from a probability of "
      "{:.3f}, tracked from {:.2f}; "
      "tracker {:.1f} µs a frame\n{:<40} {:>17} {:>17} {:>18}\n",
      cell.photons, counts.required, counts.frames, cell.threshold, cell.min_probability,
      cell.tracker_us, "", "frame by frame", "tracked", "difference");
  for (const TrackingFigure& which : kTrackingFigures) {
    const Figure change = difference(cell, which);
    text += fmt::format("{:<40} {:>17} {:>17} {:>18}{}\n", which.heading,
                        text_of(figure(cell.frame_by_frame, which)),
                        text_of(figure(cell.tracked, which)), text_of(change),
                        is_better(change, which.less_is_better) ? "" : "  not better");
  }
  return text;
}

void bench_track(TrackOptionsOfBench options) {
  refuse_debug_build();
  TrackingBenchmarkOptions& benchmark = options.benchmark;
  if (options.run.quick) benchmark.frames = 50;
  if (!options.wind.empty()) {
    if (options.wind.size() % 2 != 0) throw UsageError("--wind takes pairs of numbers, x and y");
    benchmark.sequence.wind.clear();
    for (std::size_t i = 0; i < options.wind.size(); i += 2)
      benchmark.sequence.wind.push_back({options.wind[i], options.wind[i + 1]});
  }
  const std::string folder = options.run.folder();
  int parts = 0;
  int kept = 0;
  for (const auto& [subset, n] : {std::pair{Subset::kValidation, benchmark.validation_fields},
                                  std::pair{Subset::kTest, benchmark.test_fields}}) {
    for (int i = 0; i < n; ++i) {
      parts += sequence_parts(benchmark.frames);
      kept += kept_parts(benchmark.sequence, sequence_seed(subset, i), benchmark.frames, folder);
    }
  }
  constexpr double kSecondsPerPart = 17.0;  // measured
  fmt::print(stderr, "{} parts of 50 frames, {} of them kept from before; about {:.0f} s\n", parts,
             kept, std::ceil(kSecondsPerPart * (parts - kept) / benchmark.threads));
  const std::vector<TrackingCell> cells = options.run.watch(
      "parts", parts, [&](auto step) { return run_tracking_benchmark(benchmark, folder, step); });
  if (options.run.json) {
    fmt::print("{}\n", results_json(benchmark, cells).dump(2));
    return;
  }
  fmt::print(
      "{}, {} build\nRytov variance {}, {} frames of {} arrays; both at the thresholds "
      "best "
      "for other fields,\nthe nearest of a charge linked; ± half of the 95 % interval, {} frames "
      "drawn together\n",
      kProgram, kBuildType, benchmark.sequence.field.rytov_variance, benchmark.frames,
      benchmark.test_fields * benchmark.sequence.arrays * benchmark.sequence.arrays,
      benchmark.block_frames);
  for (const TrackingCell& cell : cells) fmt::print("{}", table(cell));
}

}  // namespace

void add_bench_track(CLI::App& bench) {
  auto options = std::make_shared<TrackOptionsOfBench>();
  TrackingBenchmarkOptions& benchmark = options->benchmark;
  CLI::App* track = bench.add_subcommand(
      "track", "Vortices followed through evolving turbulence; goes on where it ended");
  track->add_option("--frames", benchmark.frames, "frames of each array")
      ->check(CLI::Range(2, 100000))
      ->capture_default_str();
  track->add_option("--fields", benchmark.test_fields, "test fields, each of which 4 arrays see")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  track->add_option("--photons", benchmark.photons, "photons of each lenslet")
      ->delimiter(',')
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  track
      ->add_option("--rytov", benchmark.sequence.field.rytov_variance,
                   "Rytov variance of the turbulence")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  track
      ->add_option("--wind", options->wind,
                   "wind in pitches a frame: x,y of the first screen, … x,y of the last")
      ->delimiter(',');
  track
      ->add_option("--steps", benchmark.sequence.steps,
                   "how many times a frame the true vortices are looked up")
      ->check(CLI::Range(1, 100))
      ->capture_default_str();
  options->run.add_to(*track, "only 50 frames, to show that all of it runs", benchmark.threads);
  track->callback([options] { bench_track(*options); });
}

}  // namespace curlew
