#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>

#include "core/error.h"
#include "service/bench/bench_run.h"
#include "service/bench/detection_benchmark.h"
#include "service/bench/detection_export.h"
#include "service/bench/field_variants.h"
#include "service/commands/commands.h"
#include "service/commands/pupil_option.h"
#include "service/program/version.h"
#include "service/results/json_float.h"

namespace curlew {
namespace {

struct DetectOptionsOfBench {
  DetectionBenchmarkOptions benchmark;
  BenchRun run;
  std::string export_folder;  ///< empty: measure
  bool field = false;  ///< the variants of field_variants() in place of the laboratory's cells
};

/// Says in advance how long the run will take.
void announce(const DetectionBenchmarkOptions& options, const RealisationCache& cache) {
  double seconds = 0.0;
  double megabytes = 0.0;
  int realisations = 0;
  int kept = 0;
  for (const double rytov_variance : options.rytov_variances) {
    FieldParameters field = options.field;
    field.rytov_variance = rytov_variance;
    const RealisationCost cost = realisation_cost(field);
    megabytes = std::max(megabytes, cost.megabytes);
    const auto count = [&](Subset subset, int n) {
      for (int i = 0; i < n; ++i) {
        ++realisations;
        if (cache.holds(field, realisation_seed(subset, i)))
          ++kept;
        else
          seconds += cost.seconds;
      }
    };
    count(Subset::kValidation, options.validation_realisations);
    count(Subset::kTest, options.test_realisations);
  }
  const double image_mb = 4e-6 * options.field.rows * options.field.cols * options.field.window_px *
                          options.field.window_px;
  megabytes = megabytes * options.threads +
              image_mb * (options.test_realisations + options.validation_realisations);
  fmt::print(stderr, "{} realisations, {} of them kept from before; about {:.0f} s, {:.0f} MB\n",
             realisations, kept, std::ceil(seconds / options.threads), megabytes);
}

std::map<std::string, CentroidMethod> centroid_methods() {
  std::map<std::string, CentroidMethod> methods;
  for (std::size_t i = 0; i < kCentroidMethodNames.size(); ++i)
    methods.emplace(kCentroidMethodNames[i], static_cast<CentroidMethod>(i));
  return methods;
}

std::string photons_text(double photons) {
  return std::isfinite(photons) ? fmt::format("{} photons", photons) : "no noise";
}

nlohmann::ordered_json row_json(const DetectionRowResult& row) {
  nlohmann::ordered_json json;
  json["name"] = row.name;
  json["method"] = row.method;
  json["threshold"] = json_number(row.threshold);
  for (const ScoreMember& member : kScoreMembers) {
    const Interval interval = interval_of(row.samples, member.value);
    json[std::string(member.name)] = {{"value", json_number(row.score.*member.value)},
                                      {"low", json_number(interval.low)},
                                      {"high", json_number(interval.high)}};
  }
  json["false_alarms_at_half"] = row.false_at_half;
  json["us_per_frame"] = row.microseconds;
  return json;
}

nlohmann::ordered_json results_json(const DetectionBenchmarkOptions& options,
                                    const std::vector<DetectionCellResult>& cells) {
  nlohmann::ordered_json json;
  json["program"] = kProgram;
  json["lenslet"] = options.field.lenslet;
  json["window_px"] = options.field.window_px;
  json["samples_per_lambda_w"] = options.field.samples_per_lambda_w;
  json["pupil"] = pupil_word(options.measurement.pupil);
  json["faded"] = options.measurement.faded;
  json["blur"] = options.measurement.blur;
  json["sky_e"] = options.measurement.sky_e;
  json["read_noise_e"] = options.measurement.read_noise_e;
  json["validation_realisations"] = options.validation_realisations;
  json["test_realisations"] = options.test_realisations;
  json["false_alarms_of_recall"] = kStatedFalseAlarms;
  json["interval"] = 0.95;
  for (const DetectionCellResult& cell : cells) {
    nlohmann::ordered_json entry;
    entry["rytov_variance"] = cell.rytov_variance;
    entry["photons"] = json_number(cell.photons);
    entry["required"] = cell.required;
    entry["measuring_ms"] = cell.measuring_ms;
    for (const DetectionRowResult& row : cell.rows) entry["rows"].push_back(row_json(row));
    json["cells"].push_back(entry);
  }
  return json;
}

/// Returns the value and half the width of its interval.
std::string figure(const DetectionRowResult& row, double DetectionScore::*value) {
  if (!std::isfinite(row.score.*value)) return "–";
  const Interval interval = interval_of(row.samples, value);
  return fmt::format("{:.3f} ± {:.2f}", row.score.*value, 0.5 * (interval.high - interval.low));
}

std::string table(const DetectionCellResult& cell, int frames) {
  std::string text = fmt::format(
      "\nRytov variance {}, {}: {} vortices in {} frames, {:.2f} ms to measure a frame\n{:<21}",
      cell.rytov_variance, photons_text(cell.photons), cell.required, frames, cell.measuring_ms,
      "");
  for (const char* heading : {"F1", "best F1", "av. prec.", "recall", "rms", "isolated"})
    text += fmt::format(" {:>12}", heading);
  text += fmt::format(" {:>7}\n", "µs");
  for (const DetectionRowResult& row : cell.rows) {
    text += fmt::format("{:<21}", row.name);
    for (const ScoreMember& member : kScoreMembers)
      text += fmt::format(" {:>12}", figure(row, member.value));
    text += fmt::format(" {:>7.1f}\n", row.microseconds);
  }
  return text;
}

void export_benchmark(const DetectOptionsOfBench& options, const RealisationCache& cache) {
  const DetectionBenchmarkOptions& benchmark = options.benchmark;
  const int per_cell = benchmark.test_realisations + benchmark.validation_realisations;
  const auto n = static_cast<std::int64_t>(benchmark.rytov_variances.size()) * per_cell;
  options.run.watch("fields", n, [&](auto step) {
    export_detection_benchmark(benchmark, cache, options.export_folder, step);
    return 0;
  });
  fmt::print("{}: README.md says what is in it\n", options.export_folder);
}

void print_variant(const FieldVariant& variant, const DetectionCellResult& cell) {
  for (const DetectionRowResult& row : cell.rows) {
    fmt::print("{:<30} {:>10}", variant.name, row.name);
    for (const auto value : {&DetectionScore::f1, &DetectionScore::average_precision,
                             &DetectionScore::recall, &DetectionScore::rms})
      fmt::print(" {:>12}", figure(row, value));
    fmt::print(" {:>7.2f}\n", row.false_at_half);
  }
  std::fflush(stdout);
}

/// Measures whitened and classifier on all variants of the sensor.
void bench_field(const DetectOptionsOfBench& options, const RealisationCache& cache) {
  nlohmann::ordered_json json;
  json["program"] = kProgram;
  if (!options.run.json) {
    fmt::print("{:<41}", "");
    for (const char* heading : {"F1", "av. prec.", "recall", "rms"}) fmt::print(" {:>12}", heading);
    fmt::print("   false a frame at p >= .5\n");
  }
  const std::vector<double>& photons = options.benchmark.photons;
  const bool noisy =
      std::all_of(photons.begin(), photons.end(), [](double n) { return std::isfinite(n); });
  for (const FieldVariant& variant :
       field_variants(options.benchmark.field, options.benchmark.measurement, noisy)) {
    DetectionBenchmarkOptions benchmark = options.benchmark;
    benchmark.baselines = false;
    benchmark.field = variant.field;
    benchmark.measurement = variant.measurement;
    const auto n = static_cast<std::int64_t>(benchmark.rytov_variances.size()) *
                   (benchmark.test_realisations + benchmark.validation_realisations);
    const auto cells = options.run.watch(
        "fields", n, [&](auto step) { return run_detection_benchmark(benchmark, cache, step); });
    nlohmann::ordered_json entry = results_json(benchmark, cells);
    entry["variant"] = variant.name;
    json["variants"].push_back(entry);
    if (options.run.json) continue;
    for (const DetectionCellResult& cell : cells) print_variant(variant, cell);
  }
  if (options.run.json) fmt::print("{}\n", json.dump(2));
}

void bench_detect(DetectOptionsOfBench options) {
  refuse_debug_build();
  DetectionBenchmarkOptions& benchmark = options.benchmark;
  if (options.run.quick) benchmark.test_realisations = benchmark.validation_realisations = 4;
  for (double& photons : benchmark.photons) {
    if (photons == 0.0) photons = kWithoutNoise;
  }
  const RealisationCache cache(options.run.folder());
  if (options.field) {
    bench_field(options, cache);
    return;
  }
  announce(benchmark, cache);
  if (!options.export_folder.empty()) {
    export_benchmark(options, cache);
    return;
  }
  const int per_cell = benchmark.test_realisations + benchmark.validation_realisations;
  const auto n = static_cast<std::int64_t>(benchmark.rytov_variances.size()) * per_cell;
  const std::vector<DetectionCellResult> cells = options.run.watch(
      "fields", n, [&](auto step) { return run_detection_benchmark(benchmark, cache, step); });
  if (options.run.json) {
    fmt::print("{}\n", results_json(benchmark, cells).dump(2));
    return;
  }
  fmt::print(
      "{}, {} build\nF1 at the threshold best for {} other frames, and at the best for these; "
      "average "
      "precision; recall at\n{} false alarms a frame; rms error in pitches, of all hits and of "
      "vortices over {} from any other;\n± half of the 95 % interval\n",
      kProgram, kBuildType, benchmark.validation_realisations, kStatedFalseAlarms, kIsolation);
  for (const DetectionCellResult& cell : cells)
    fmt::print("{}", table(cell, benchmark.test_realisations));
  fmt::print("\n");
  for (const DetectionRowResult& row : cells.front().rows)
    fmt::print("{:<22} {}\n", row.name, row.method);
}

void add_centroid_options(CLI::App& detect, MeasurementOptions& measurement) {
  detect
      .add_option("--centroid", measurement.method,
                  "centroid method: thresholded (default), plain, weighted, correlation, "
                  "brightest_pixels or maximum_likelihood")
      ->transform(CLI::CheckedTransformer(centroid_methods()));
  detect
      .add_option("--threshold-noise", measurement.threshold_noise,
                  "threshold of all centroids but plain, in read noises")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  detect
      .add_option("--spot-sigma", measurement.spot_sigma_px,
                  "sigma of the Gaussian that weighted, correlation and maximum_likelihood use, "
                  "px; 0: that of the diffraction limit")
      ->capture_default_str();
  detect
      .add_option("--reference-pull", measurement.reference_pull,
                  "light that pulls the weighted centroid to the reference, in read noises")
      ->capture_default_str();
  detect
      .add_option("--brightest-pixels", measurement.brightest_pixels,
                  "how many pixels the centroid brightest_pixels uses; 0: chosen")
      ->capture_default_str();
}

/// Adds what the sensor is, and what is in its way.
void add_sensor_options(CLI::App& detect, DetectionBenchmarkOptions& benchmark) {
  detect.add_option("--blur", benchmark.measurement.blur, "sigma of the spots' blur, λ/w")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  detect.add_option("--read-noise", benchmark.measurement.read_noise_e, "electrons, rms")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  detect
      .add_option("--sky", benchmark.measurement.sky_e,
                  "electrons a pixel that the dark does not have; the level is measured")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  detect.add_flag("--neighbours", benchmark.field.neighbours,
                  "light beyond a window falls on the next one");
  add_pupil_option(detect, benchmark.measurement.pupil);
  detect
      .add_option("--faded", benchmark.measurement.faded,
                  "part of the lenslets that are dark; every frame has others")
      ->check(CLI::Range(0.0, 0.9))
      ->capture_default_str();
}

}  // namespace

void add_bench_detect(CLI::App& bench) {
  auto options = std::make_shared<DetectOptionsOfBench>();
  DetectionBenchmarkOptions& benchmark = options->benchmark;
  CLI::App* detect = bench.add_subcommand(
      "detect", "Detectors of vortices compared on simulated turbulence; goes on where it ended");
  detect->add_option("--realisations", benchmark.test_realisations, "test fields of each cell")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  detect
      ->add_option("--validation", benchmark.validation_realisations,
                   "fields of each cell on which thresholds are chosen")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  detect->add_option("--rytov", benchmark.rytov_variances, "Rytov variances")
      ->delimiter(',')
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  detect->add_option("--photons", benchmark.photons, "photons of each lenslet; 0: no noise")
      ->delimiter(',')
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  detect->add_option("--lenslet", benchmark.field.lenslet, "side of a lenslet, √(λL)")
      ->capture_default_str();
  detect->add_option("--window", benchmark.field.window_px, "pixels per lenslet side")
      ->check(CLI::Range(4, 64))
      ->capture_default_str();
  detect->add_option("--sampling", benchmark.field.samples_per_lambda_w, "pixels per λ/w")
      ->capture_default_str();
  add_centroid_options(*detect, benchmark.measurement);
  detect->add_flag(
      "--field", options->field,
      "whitened and classifier on sensors as they are outside the laboratory: blurred, "
      "coarse, turned, faded, sky-lit; by default at Rytov variance 2, 1000 photons");
  detect->add_option("--export", options->export_folder,
                     "measure nothing, but write frames, truth and a scorer into this new folder");
  add_sensor_options(*detect, benchmark);
  detect
      ->add_option("--controlled", benchmark.controlled_rates,
                   "adds rows for whitened and classifier at these rates of false alarms a frame")
      ->delimiter(',')
      ->check(CLI::PositiveNumber);
  options->run.add_to(*detect, "only 4 fields of each kind, to show that all of it runs",
                      benchmark.threads);
  detect->callback([options, detect] {
    // One cell of the laboratory is enough to compare sensors.
    if (options->field && detect->count("--rytov") == 0) options->benchmark.rytov_variances = {2.0};
    if (options->field && detect->count("--photons") == 0) options->benchmark.photons = {1000.0};
    bench_detect(*options);
  });
}

}  // namespace curlew
