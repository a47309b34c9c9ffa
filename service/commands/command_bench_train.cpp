#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <fstream>
#include <memory>
#include <thread>

#include "core/error.h"
#include "service/bench/bench_run.h"
#include "service/commands/commands.h"
#include "service/program/interrupt.h"
#include "service/training/detection_training.h"

namespace curlew {
namespace {

struct TrainOptionsOfBench {
  TrainingOptions training;
  std::string cache = default_realisation_folder();
  std::string out;  ///< empty: as the file in detect/classifier/
};

void bench_train(const TrainOptionsOfBench& options) {
  refuse_debug_build();
  const TrainingOptions& training = options.training;
  const RealisationCache cache(options.cache);
  const TrainingReport report =
      train_vortex_classifier(training, cache, [](const std::string& line) {
        fmt::print(stderr, "{}\n", line);
        if (interrupted()) throw Failure("interrupted; the simulated fields are kept");
      });
  const std::string command = fmt::format(
      "curlew bench train --fields {} --validation {} --steps {} --batch {} --rate {} "
      "--seed {}{}{}",
      training.fields, training.validation_fields, training.steps, training.batch,
      training.learning_rate, training.seed, training.from_shipped ? " --from-shipped" : "",
      training.reviewer ? " --reviewer" : "");
  const std::string out = !options.out.empty() ? options.out
                          : training.reviewer  ? "vortex_reviewer_weights.inc"
                                               : "vortex_classifier_weights.inc";
  std::ofstream file(out);
  file << weights_text(report, training, command);
  if (!file.flush()) throw Failure(fmt::format("{} cannot be written", out));
  fmt::print(
      "{}\nsimulating {:.0f} s, measuring {:.0f} s, training {:.0f} s, validating {:.0f} s\n",
      command, report.simulating_s, report.measuring_s, report.training_s, report.validating_s);
  fmt::print("Rytov variance, photons: average precision, F1, rms in pitches\n");
  for (const ValidationScore& score : report.validation) fmt::print("{}\n", score.text());
}

}  // namespace

void add_bench_train(CLI::App& bench) {
  auto options = std::make_shared<TrainOptionsOfBench>();
  TrainingOptions& training = options->training;
  training.threads = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  CLI::App* train = bench.add_subcommand(
      "train", "Trains the vortex classifier and writes its weights; needs a new build to be used");
  train->add_option("--fields", training.fields, "simulated fields to train on")
      ->capture_default_str();
  train
      ->add_option("--validation", training.validation_fields,
                   "validation fields of each turbulence")
      ->capture_default_str();
  train->add_option("--steps", training.steps, "steps of the optimiser")->capture_default_str();
  train->add_option("--batch", training.batch, "nodes in each step")->capture_default_str();
  train->add_option("--rate", training.learning_rate, "learning rate of the optimiser")
      ->capture_default_str();
  train->add_option("--seed", training.seed, "seed of all random numbers")->capture_default_str();
  train->add_flag("--from-shipped", training.from_shipped,
                  "begin with the weights that are compiled in, not at random");
  train->add_flag("--reviewer", training.reviewer,
                  "train only the reviewer, and keep judge, scout and screen");
  train->add_option("--cache", options->cache, "folder in which simulated fields are kept")
      ->capture_default_str();
  train->add_option("--threads", training.threads, "threads that simulate fields")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  train->add_option(
      "--out", options->out,
      "file that the weights are written to; by default vortex_classifier_weights.inc "
      "or vortex_reviewer_weights.inc, as in detect/classifier/");
  train->callback([options] { bench_train(*options); });
}

}  // namespace curlew
