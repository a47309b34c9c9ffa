#include "service/bench/centroid_benchmark.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <numbers>

#include "centroiding/centroid.h"
#include "centroiding/centroid_methods.h"
#include "service/bench/plain_loops.h"
#include "service/stages.h"

namespace curlew {
namespace {

/// Says how sharp a bench frame's spots are at most, as a calibration would find it.
double spot_sharpness(const BenchCase& which) {
  const double sigma_px = bench_spot_sigma_px(which);
  return std::exp(0.5 / (sigma_px * sigma_px));
}

/// Tilts the rows of windows. Where they would leave the frame they stay at its rim.
Sensor tilted(Sensor sensor, double degrees) {
  const double slope = std::tan(degrees * std::numbers::pi / 180.0);
  for (Window& window : sensor.window) {
    const int moved = static_cast<int>(std::lround(slope * window.x0));
    window.y0 = std::clamp(window.y0 + moved, 0, sensor.frame_rows - window.h);
  }
  return sensor;
}

CentroidTimes time_all(const std::vector<std::function<void()>>& things, int rounds,
                       const std::function<void()>& prepare) {
  std::vector<TimedRun> runs;
  runs.reserve(things.size());
  for (const std::function<void()>& thing : things)
    runs.push_back({prepare ? prepare : thing, thing});
  const std::vector<RoundTimes> times = time_in_turn(runs, rounds);
  return {times[0], times[1], times[2], times[3], times[4], times[5], times[6], times[7], times[8]};
}

template <typename Pixel>
CentroidBenchmark time_pixels(const BenchCase& which, PixelType pixel_type, int rounds) {
  FrameRotation frames(which, pixel_type, BenchSlopes::kRandom);
  const FrameFormat& format = frames.format();
  Config config;
  config.centroid.threshold_adu = kBenchThresholdAdu;
  Sensor sensor = tiled_sensor(which);
  const CentroidPlan without_maps(sensor, format, config.centroid);
  add_maps(sensor, 1);
  sensor.spot_sharpness = spot_sharpness(which);
  const Plan plan(sensor, format, config);
  const CentroidPlan tilted_plan(tilted(sensor, 1.0), format, config.centroid);
  WindowFollower follower(*plan.follower);
  FrameSlot slot(plan);
  FrameSlot following(plan, &follower);
  const PlainMaps maps(sensor, format, kBenchThresholdAdu);
  Centroids centroids(which.rows, which.cols);
  PlainLoops<Pixel> plain(which, frames, maps);

  CentroidBenchmark result;
  result.which = which;
  result.pixel_type = pixel_type;
  result.frame_bytes = format.bytes();
  result.cold_frames = static_cast<int>(frames.size());
  const int pilot = std::max(1, rounds / 5);
  result.windows_build =
      fastest_build(pilot, [&](PlainBuild build) { plain.find(build, PlainOrder::kWindows); });
  result.rows_build =
      fastest_build(pilot, [&](PlainBuild build) { plain.find(build, PlainOrder::kRows); });
  result.read_build = fastest_build(pilot, [&](PlainBuild build) { plain.read(build); });
  const std::vector<std::function<void()>> things{
      [&] {
        slot.frame = &frames.current();
        kStages.front().run(plan, slot);
      },
      [&] {
        following.frame = &frames.current();
        kStages.front().run(plan, following);
      },
      [&] { find_centroids(plan.centroid, frames.current().view(), centroids); },
      [&] {
        find_centroids(plan.centroid, frames.current().view(), centroids,
                       {.windows = &plan.centroid.spots});
      },
      [&] { find_centroids(tilted_plan, frames.current().view(), centroids); },
      [&] { find_centroids(without_maps, frames.current().view(), centroids); },
      [&] { plain.find(result.windows_build, PlainOrder::kWindows); },
      [&] { plain.find(result.rows_build, PlainOrder::kRows); },
      [&] { plain.read(result.read_build); }};
  result.warm = time_all(things, rounds, {});
  result.cold = time_all(things, rounds, [&] { frames.advance(); });
  return result;
}

}  // namespace

CentroidBenchmark time_centroids(const BenchCase& which, PixelType pixel_type, int rounds) {
  return pixel_type == PixelType::kU8 ? time_pixels<std::uint8_t>(which, pixel_type, rounds)
                                      : time_pixels<std::uint16_t>(which, pixel_type, rounds);
}

std::vector<CentroidMethodTimes> time_centroid_methods(const BenchCase& which, int rounds) {
  const BenchFrame frame = make_bench_frame(which, BenchSlopes::kRandom, 1);
  Sensor sensor = tiled_sensor(which);
  std::vector<CentroidPlan> plans;
  for (std::size_t i = 0; i < kCentroidMethodNames.size(); ++i) {
    const auto method = static_cast<CentroidMethod>(i);
    if (!is_centre_of_gravity(method) && which.window_px > kMaxMethodWindow) continue;
    sensor.method = method;
    plans.emplace_back(sensor, frame.format,
                       CentroidOptions{.threshold_adu = kBenchThresholdAdu, .method = method});
  }
  Centroids centroids(which.rows, which.cols);
  std::vector<TimedRun> runs;
  runs.reserve(plans.size());
  for (const CentroidPlan& plan : plans)
    runs.push_back({{}, [&] { find_centroids(plan, frame.view(), centroids); }});
  const std::vector<RoundTimes> times = time_in_turn(runs, rounds);
  std::vector<CentroidMethodTimes> methods;
  for (std::size_t i = 0; i < plans.size(); ++i)
    methods.push_back({std::string(name_of(plans[i].method)), times[i]});
  return methods;
}

}  // namespace curlew
