#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>

#include "acquisition/loop_source.h"
#include "core/error.h"
#include "service/bench/bench_frames.h"
#include "service/bench/bench_options.h"
#include "service/bench/bench_run.h"
#include "service/commands/commands.h"
#include "service/pipeline.h"
#include "service/program/progress.h"
#include "service/results/latency_report.h"
#include "service/thread_placement.h"

namespace curlew {
namespace {

struct BenchOptions {
  BenchSize size;
  std::int64_t frames = 2000;
  std::string method = "circulation";
  std::string threads = "inline";
  std::vector<int> cpus;
  bool json = false;
};

LoopSource::Frames make_frames(const BenchCase& which) {
  constexpr std::uint64_t kDistinctFrames = 4;
  LoopSource::Frames frames;
  for (std::uint64_t seed = 1; seed <= kDistinctFrames; ++seed) {
    const BenchFrame drawn = make_bench_frame(which, BenchSlopes::kSmooth, seed);
    auto frame = std::make_shared<FrameBuffer>(drawn.format);
    std::copy_n(drawn.view().pixels, drawn.format.bytes(), frame->data());
    frames.push_back(std::move(frame));
  }
  return frames;
}

struct Measured {
  RunReport report;
  std::string pinning;
};

Measured measure(const BenchCase& which, const BenchOptions& options) {
  constexpr std::int64_t kWarmUp = 100;
  const LoopSource::Frames frames = make_frames(which);
  Sensor sensor = tiled_sensor(which);
  add_maps(sensor, 1);
  Config config;
  config.centroid.threshold_adu = kBenchThresholdAdu;
  config.detect.method = setting_from<DetectMethod>(options.method, "--method");
  config.pipeline.threads = setting_from<Threading>(options.threads, "--threads");
  config.pipeline.cpus = options.cpus;
  ThreadPlacement placement(options.cpus, 0);
  Pipeline pipeline(std::make_shared<const Plan>(sensor, frames.front()->format(), config),
                    config.pipeline, placement.thread_start());
  LoopSource warm_up(frames, kWarmUp);
  RecordedFeed warm_up_feed(warm_up, {});
  pipeline.run(warm_up_feed, {});
  LoopSource source(frames, options.frames);
  RecordedFeed feed(source, {});
  Progress progress("bench", options.frames);
  Publisher publisher;
  publisher.finish = [&](const FrameSlot&, std::int64_t) { progress.step(); };
  Measured measured;
  measured.report = pipeline.run(feed, publisher);
  measured.pinning = placement.description();
  return measured;
}

void bench_latency(const BenchOptions& options) {
  if (options.frames < 1) throw UsageError("--frames must be at least 1");
  const std::vector<BenchCase> all = options.size.window_cases();
  refuse_debug_build();
  nlohmann::ordered_json json = machine_json();
  json["threads"] = options.threads;
  json["method"] = options.method;
  json["frames"] = options.frames;
  std::string text;
  for (const BenchCase& which : all) {
    const auto [report, pinning] = measure(which, options);
    json["pinning"] = pinning;
    nlohmann::ordered_json entry;
    entry["rows"] = which.rows;
    entry["cols"] = which.cols;
    entry["window_px"] = which.window_px;
    entry["latency_us"] = latency_json(report);
    json["cases"].push_back(entry);
    text +=
        fmt::format("\n{} x {} lenslets of {} x {} px, u16, dark, flat and bad pixels, {} frames\n",
                    which.cols, which.rows, which.window_px, which.window_px, report.frames);
    text += latency_table(report);
    if (const std::string followed = followed_text(report); !followed.empty())
      text += followed + "\n";
  }
  if (options.json) {
    fmt::print("{}\n", json.dump(2));
    return;
  }
  fmt::print("{}method {}, threads {}, pinned: {}\n{}", machine_text(), options.method,
             options.threads, json["pinning"].get<std::string>(), text);
}

}  // namespace

void add_bench(CLI::App& app) {
  auto options = std::make_shared<BenchOptions>();
  CLI::App* bench = app.add_subcommand("bench", "Benchmarks; never from a debug build");
  bench->require_subcommand(1);
  CLI::App* latency = bench->add_subcommand(
      "latency", "Latency of every stage; without sizes: 40x40 of 6 px, 80x80 of 10, 30x30 of 32");
  options->size.add_windows_to(*latency);
  latency->add_option("--frames", options->frames, "frames of each case")->capture_default_str();
  latency
      ->add_option("--method", options->method,
                   "how vortices are looked for; the default is what older figures are of")
      ->capture_default_str();
  latency
      ->add_option("--threads", options->threads,
                   "all stages on one thread (inline) or one each (per_stage)")
      ->capture_default_str();
  latency->add_option("--cpus", options->cpus, "CPUs that the threads are pinned to, in turn")
      ->delimiter(',');
  latency->add_flag("--json", options->json, "print JSON");
  latency->callback([options] { bench_latency(*options); });
  add_bench_centroid(*bench);
  add_bench_split(*bench);
  add_bench_circulation(*bench);
  add_bench_detect(*bench);
  add_bench_train(*bench);
  add_bench_classifier(*bench);
  add_bench_false_alarms(*bench);
  add_bench_phase(*bench);
  add_bench_bound(*bench);
  add_bench_track(*bench);
}

}  // namespace curlew
