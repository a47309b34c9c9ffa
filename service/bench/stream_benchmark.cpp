#include "service/bench/stream_benchmark.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

#include "core/error.h"
#include "service/bench/bench_timing.h"
#include "service/bench/plain_loops.h"
#include "service/program/interrupt.h"
#include "service/stages.h"

namespace curlew {
namespace {

/// A slot with all that frames teach it.
struct StreamTrial {
  explicit StreamTrial(const Plan& the_plan)
      : plan(the_plan), follower(*plan.follower), slot(plan, &follower) {}

  /// Runs the stages as far as the list of vortices.
  void finish() {
    constexpr std::size_t kStagesToVortices = 4;
    for (std::size_t stage = 0; stage < kStagesToVortices; ++stage) kStages[stage].run(plan, slot);
  }

  /// Works on all rows of the frame but the last ones, which arrive `rows_at_once` at a time. Notes
  /// how long it took in all, and at most for one such arrival.
  void work_ahead(int rows_at_once, double& all_us, double& slowest_us) {
    all_us = slowest_us = 0.0;
    for (int ready = rows_at_once; ready < slot.frame->format().rows; ready += rows_at_once) {
      const double us = time_us([&] { measure_ahead(plan, slot, ready); });
      all_us += us;
      slowest_us = std::max(slowest_us, us);
    }
  }

  const Plan& plan;
  WindowFollower follower;
  FrameSlot slot;
};

bool same_bits(const Image<float>& a, const Image<float>& b) {
  return std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
}

bool same_results(const FrameSlot& a, const FrameSlot& b) {
  return same_bits(a.slopes.x, b.slopes.x) && same_bits(a.slopes.y, b.slopes.y) &&
         same_bits(a.slopes.variance_x, b.slopes.variance_x) &&
         same_bits(a.circulation.value, b.circulation.value) &&
         a.vortices.size() == b.vortices.size();
}

Sensor sensor_of_case(const BenchCase& which) {
  Sensor sensor = tiled_sensor(which);
  add_maps(sensor, 1);
  return sensor;
}

Config config_of_case() {
  Config config;
  config.centroid.measure_ahead = true;
  config.centroid.threshold_adu = kBenchThresholdAdu;
  config.detect.method = DetectMethod::kCirculation;
  return config;
}

}  // namespace

StreamBenchmark time_stream(const BenchCase& which, int rounds) {
  FrameRotation frames = FrameRotation::of_one_wavefront(which);
  const Sensor sensor = sensor_of_case(which);
  const Plan plan(sensor, frames.format(), config_of_case());
  if (!plan.follower)
    throw UsageError(
        "bench stream needs 12 lenslets or more: frames of fewer are measured when they are whole");
  const PlainMaps maps(sensor, frames.format(), kBenchThresholdAdu);
  PlainLoops<std::uint16_t> plain(which, frames, maps);
  StreamTrial whole(plan);
  StreamTrial streamed(plan);
  constexpr int kRowsAtOnce = 8;
  StreamBenchmark result;
  result.which = which;
  result.rows_at_once = kRowsAtOnce;
  std::vector<double> whole_us, streamed_us, ahead_us, slowest_us, read_us, plain_us;
  const PlainBuild read_build = fastest_build(20, [&](PlainBuild build) { plain.read(build); });
  const PlainBuild rows_build =
      fastest_build(20, [&](PlainBuild build) { plain.find(build, PlainOrder::kRows); });
  const int warm_up = rounds / 10 + 3;
  for (int round = -warm_up; round < rounds; ++round) {
    if (interrupted()) throw Failure("interrupted");
    frames.advance();
    FrameBuffer& frame = frames.current();
    whole.slot.frame = streamed.slot.frame = &frame;
    const double from_whole = time_us([&] { whole.finish(); });
    // The two frames that come between push this one out of the second cache.
    frames.advance();
    const double read = time_us([&] { plain.read(read_build); });
    frames.advance();
    const double by_rows = time_us([&] { plain.find(rows_build, PlainOrder::kRows); });
    double ahead = 0.0, slowest = 0.0;
    streamed.work_ahead(kRowsAtOnce, ahead, slowest);
    const double from_last_row = time_us([&] { streamed.finish(); });
    result.same = result.same && same_results(whole.slot, streamed.slot);
    if (round < 0) continue;
    whole_us.push_back(from_whole);
    streamed_us.push_back(from_last_row);
    ahead_us.push_back(ahead);
    slowest_us.push_back(slowest);
    read_us.push_back(read);
    plain_us.push_back(by_rows);
  }
  result.whole = summarise(whole_us);
  result.streamed = summarise(streamed_us);
  result.ahead = summarise(ahead_us);
  result.slowest = summarise(slowest_us);
  result.read = summarise(read_us);
  result.plain_rows = summarise(plain_us);
  return result;
}

}  // namespace curlew
