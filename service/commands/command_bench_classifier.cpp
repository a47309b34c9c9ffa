#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <memory>
#include <nlohmann/json.hpp>
#include <vector>

#include "core/error.h"
#include "core/latency_histogram.h"
#include "detect/classifier/vortex_classifier.h"
#include "service/bench/bench_run.h"
#include "service/bench/detection_dataset.h"
#include "service/bench/detection_measurement.h"
#include "service/bench/detection_score.h"
#include "service/commands/commands.h"
#include "service/results/latency_report.h"
#include "service/spot_camera.h"

namespace curlew {
namespace {

struct ClassifierBenchOptions {
  double photons = 1000.0;
  double min_probability = 0.5;
  int repeats = 300;
  std::string cache = default_realisation_folder();
  bool json = false;
};

struct ClassifierCase {
  FieldParameters field;
  int realisations;
};

/// Returns the benchmark's array, and an array of 80×80. The lenslets of the latter are smaller, so
/// that the propagated grid holds them, and turbulence gives them some 60 vortices.
std::vector<ClassifierCase> classifier_cases() {
  FieldParameters small;
  small.rytov_variance = 2.0;
  FieldParameters large;
  large.rytov_variance = 2.2;
  large.lenslet = 0.045;
  large.rows = large.cols = 80;
  return {{small, 20}, {large, 4}};
}

/// Means over the frames, and the times of all runs.
struct ClassifierCost {
  double required = 0.0;  ///< true vortices that are required
  double reported = 0.0;
  double nodes = 0.0;     ///< nodes that were judged
  double reviewed = 0.0;  ///< nodes that were reviewed
  double lenslets = 0.0;
  LatencyHistogram times;
};

ClassifierCost measure_cost(const ClassifierCase& which, double min_review,
                            const ClassifierBenchOptions& options, const RealisationCache& cache) {
  using Clock = std::chrono::steady_clock;
  MeasurementOptions measurement;
  measurement.photons = options.photons;
  const MeasurementPlan plan(which.field, measurement);
  const ClassifierPlan classifier(
      {.min_probability = options.min_probability, .min_review = min_review},
      spot_camera(plan.sensor()), plan.format());
  ClassifierWorkspace workspace(classifier);
  VortexList vortices(classifier.features().lenslet_count());
  MeasuredFrame frame(plan);
  const Interior interior{which.field.rows, which.field.cols};
  ClassifierCost cost;
  for (int i = 0; i < which.realisations; ++i) {
    const std::uint64_t seed = realisation_seed(Subset::kValidation, i);
    const Realisation realisation = cache.read_or_simulate(which.field, seed);
    measure_frame(plan, realisation, seed, frame);
    for (const GradedVortex& vortex : grade_vortices(realisation.vortices))
      cost.required += vortex.required && interior.contains(vortex.x, vortex.y) ? 1.0 : 0.0;
    for (int repeat = 0; repeat < options.repeats; ++repeat) {
      const Clock::time_point start = Clock::now();
      find_classified_vortices(classifier, frame.frame.view(), frame.shift(), frame.centroids,
                               frame.circulation, workspace, vortices);
      const auto taken =
          std::chrono::duration_cast<std::chrono::nanoseconds>(Clock::now() - start).count();
      // The first tenth only warms up.
      if (repeat >= options.repeats / 10) cost.times.record(taken);
    }
    cost.reported += static_cast<double>(vortices.size());
    cost.nodes += static_cast<double>(workspace.nodes.size());
    cost.reviewed += static_cast<double>(workspace.to_review.size());
    cost.lenslets += static_cast<double>(workspace.measured.count);
  }
  for (double* sum : {&cost.required, &cost.reported, &cost.nodes, &cost.reviewed, &cost.lenslets})
    *sum /= which.realisations;
  return cost;
}

void bench_classifier(const ClassifierBenchOptions& options) {
  refuse_debug_build();
  const RealisationCache cache(options.cache);
  nlohmann::ordered_json json = machine_json();
  json["photons"] = options.photons;
  json["min_probability"] = options.min_probability;
  std::string text;
  const auto measure = [&](const ClassifierCase& which, double min_review) {
    const FieldParameters& field = which.field;
    const ClassifierCost cost = measure_cost(which, min_review, options, cache);
    const auto us = [&](double part) {
      return 1e-3 * static_cast<double>(cost.times.percentile_ns(part));
    };
    json["cases"].push_back({{"rows", field.rows},
                             {"cols", field.cols},
                             {"window_px", field.window_px},
                             {"lenslet", field.lenslet},
                             {"rytov_variance", field.rytov_variance},
                             {"frames", which.realisations},
                             {"vortices", cost.required},
                             {"reported", cost.reported},
                             {"review", min_review < kNoNode},
                             {"nodes_judged", cost.nodes},
                             {"nodes_reviewed", cost.reviewed},
                             {"lenslets_measured", cost.lenslets},
                             {"p50_us", us(0.5)},
                             {"p90_us", us(0.9)},
                             {"p99_us", us(0.99)}});
    text += fmt::format(
        "{:>3} x {:<3} {:>7} {:>9} {:>9.1f} {:>9.1f} {:>7.0f} {:>9.0f} {:>9.0f} {:>8.1f} {:>8.1f} "
        "{:>8.1f}\n",
        field.cols, field.rows, field.lenslet, field.rytov_variance, cost.required, cost.reported,
        cost.nodes, cost.reviewed, cost.lenslets, us(0.5), us(0.9), us(0.99));
  };
  for (const ClassifierCase& which : classifier_cases())
    for (const double min_review : {ClassifierOptions{}.min_review, kNoNode})
      measure(which, min_review);
  if (options.json) {
    fmt::print("{}\n", json.dump(2));
    return;
  }
  fmt::print(
      "The vortex classifier on one thread, frames of propagated fields, {} photons, means a "
      "frame\n\n"
      "lenslets   side  variance  vortices  reported   nodes  reviewed  lenslets   p50 us   p90 us"
      "   p99 us\n"
      "{}",
      options.photons, text);
}

}  // namespace

void add_bench_classifier(CLI::App& bench) {
  auto options = std::make_shared<ClassifierBenchOptions>();
  CLI::App* classifier = bench.add_subcommand(
      "classifier", "What the vortex classifier costs a frame: 16x16, and 80x80 lenslets");
  classifier->add_option("--photons", options->photons, "photons of each lenslet")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  classifier
      ->add_option("--min-probability", options->min_probability,
                   "least probability of a reported vortex")
      ->capture_default_str();
  classifier->add_option("--repeats", options->repeats, "how often every frame is classified")
      ->check(CLI::Range(10, 1000000))
      ->capture_default_str();
  classifier->add_option("--cache", options->cache, "folder in which simulated fields are kept")
      ->capture_default_str();
  classifier->add_flag("--json", options->json, "print JSON");
  classifier->callback([options] { bench_classifier(*options); });
}

}  // namespace curlew
