#include "service/bench/latency_benchmark.h"

#include <algorithm>
#include <cstddef>
#include <memory>
#include <utility>

#include "service/bench/bench_timing.h"
#include "service/bench/plain_loops.h"
#include "service/feed.h"
#include "service/thread_placement.h"

namespace curlew {
namespace {

constexpr std::size_t kDistinctFrames = 4;
constexpr int kParts = static_cast<int>(kTimedParts);

/// Gathers durations in the order of the frames, in µs.
struct LatencySamples {
  std::array<std::vector<double>, kStageCount> stage;
  std::vector<double> total;
  std::vector<double> read;
  std::vector<double> plain_rows;

  void add(const FrameLatency& latency) {
    for (std::size_t i = 0; i < kStageCount; ++i)
      stage[i].push_back(1e-3 * static_cast<double>(latency.stage_ns[i]));
    total.push_back(1e-3 * static_cast<double>(latency.total_ns));
  }

  LatencyTimes times() const {
    LatencyTimes times;
    for (std::size_t i = 0; i < kStageCount; ++i) times.stage[i] = summarise(stage[i]);
    times.total = summarise(total);
    times.read = summarise(read);
    times.plain_rows = summarise(plain_rows);
    return times;
  }
};

Sensor sensor_with_maps(const BenchCase& which) {
  Sensor sensor = tiled_sensor(which);
  add_maps(sensor, 1);
  return sensor;
}

std::shared_ptr<const Plan> make_plan(const Sensor& sensor, const FrameFormat& format,
                                      const LatencyOptions& options) {
  Config config;
  config.centroid.threshold_adu = kBenchThresholdAdu;
  config.detect.method = options.method;
  config.pipeline.threads = options.threads;
  config.pipeline.cpus = options.cpus;
  return std::make_shared<const Plan>(sensor, format, config);
}

/// The pipeline of one case, and what it is held against.
class LatencyTrial {
 public:
  LatencyTrial(const BenchCase& which, const LatencyOptions& options)
      : which_(which),
        sensor_(sensor_with_maps(which)),
        frames_(which, PixelType::kU16, BenchSlopes::kSmooth),
        maps_(sensor_, frames_.format(), kBenchThresholdAdu),
        plain_(which_, frames_, maps_),
        placement_(options.cpus, 0),
        plan_(make_plan(sensor_, frames_.format(), options)),
        pipeline_(plan_, plan_->config.pipeline, placement_.thread_start()),
        other_memory_(2 * second_cache_bytes()),
        pace_hz_(options.pace_hz) {
    constexpr int kPilotRounds = 20;
    read_build_ = fastest_build(kPilotRounds, [&](PlainBuild build) { plain_.read(build); });
    rows_build_ = fastest_build(kPilotRounds,
                                [&](PlainBuild build) { plain_.find(build, PlainOrder::kRows); });
    constexpr std::int64_t kWarmUp = 100;
    run_frames(kWarmUp, 0.0, [](const FrameSlot&) {});
  }
  LatencyTrial(const LatencyTrial&) = delete;
  LatencyTrial& operator=(const LatencyTrial&) = delete;

  void run_warm(std::int64_t frames) {
    if (frames == 0) return;
    report_.merge(
        run_frames(frames, pace_hz_, [&](const FrameSlot& slot) { warm_.add(slot.latency); }));
    time_plain(warm_, false);
  }

  void run_cold(std::int64_t frames) {
    if (frames == 0) return;
    run_frames(frames, 0.0, [&](const FrameSlot& slot) {
      cold_.add(slot.latency);
      swept_ += sum_pixels(read_build_, other_memory_.data(),
                           static_cast<std::int64_t>(other_memory_.size()));
    });
    time_plain(cold_, true);
  }

  LatencyBenchmark result() const { return {which_, report_, warm_.times(), cold_.times()}; }
  std::string pinning() const { return placement_.description(); }

 private:
  template <typename Finish>
  RunReport run_frames(std::int64_t frames, double pace_hz, Finish finish) {
    LoopSource source = frames_.loop(kDistinctFrames, frames);
    RecordedFeed feed(source, {.pace_hz = pace_hz});
    Publisher publisher;
    publisher.finish = [&](const FrameSlot& slot, std::int64_t) { finish(slot); };
    return pipeline_.run(feed, publisher);
  }

  /// Times the plain loops on the same frame again, or on the next of frames that take turns.
  void time_plain(LatencySamples& samples, bool cold) {
    constexpr int kTimes = 8;
    const auto time = [&](auto run, std::vector<double>& us) {
      for (int i = 0; i < kTimes; ++i) {
        if (cold)
          frames_.advance();
        else
          run();
        us.push_back(time_us(run));
      }
    };
    time([&] { plain_.read(read_build_); }, samples.read);
    time([&] { plain_.find(rows_build_, PlainOrder::kRows); }, samples.plain_rows);
  }

  BenchCase which_;
  Sensor sensor_;
  FrameRotation frames_;
  PlainMaps maps_;
  PlainLoops<std::uint16_t> plain_;
  PlainBuild read_build_ = PlainBuild::kPortable;
  PlainBuild rows_build_ = PlainBuild::kPortable;
  ThreadPlacement placement_;
  std::shared_ptr<const Plan> plan_;
  Pipeline pipeline_;
  std::vector<std::uint8_t> other_memory_;
  double pace_hz_;
  std::uint64_t swept_ = 0;
  RunReport report_;
  LatencySamples warm_;
  LatencySamples cold_;
};

std::int64_t cold_frames(const LatencyOptions& options) {
  constexpr std::int64_t kWarmOverCold = 5;
  return (options.frames + kWarmOverCold - 1) / kWarmOverCold;
}

}  // namespace

std::int64_t frames_of_case(const LatencyOptions& options) {
  return options.frames + cold_frames(options);
}

std::vector<LatencyBenchmark> time_latency(const std::vector<BenchCase>& cases,
                                           const LatencyOptions& options,
                                           const std::function<void(std::int64_t)>& step,
                                           std::string& pinning) {
  std::vector<std::unique_ptr<LatencyTrial>> trials;
  trials.reserve(cases.size());
  for (const BenchCase& which : cases)
    trials.push_back(std::make_unique<LatencyTrial>(which, options));
  for (int part = 0; part < kParts; ++part) {
    const auto of_part = [&](std::int64_t frames) {
      return frames * (part + 1) / kParts - frames * part / kParts;
    };
    for (const auto& trial : trials) {
      trial->run_warm(of_part(options.frames));
      trial->run_cold(of_part(cold_frames(options)));
      step(of_part(options.frames) + of_part(cold_frames(options)));
    }
  }
  pinning = trials.front()->pinning();
  std::vector<LatencyBenchmark> results;
  results.reserve(trials.size());
  for (const auto& trial : trials) results.push_back(trial->result());
  return results;
}

std::vector<BenchCase> scaling_cases(int window_px) {
  std::vector<BenchCase> cases;
  for (const int side : {10, 20, 40, 80, 120, 160, 200}) cases.push_back({side, side, window_px});
  return cases;
}

}  // namespace curlew
