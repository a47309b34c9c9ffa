#include "service/bench/centroid_benchmark.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <numbers>

#include "centroiding/centroid.h"
#include "centroiding/centroid_methods.h"
#include "service/stages.h"

namespace curlew {
namespace {

/// Returns how many bytes the second cache holds. It is a guess if the system does not say.
std::size_t second_cache_bytes() {
  constexpr std::size_t kGuess = std::size_t{2} << 20U;
  const long bytes = sysconf(_SC_LEVEL2_CACHE_SIZE);
  return bytes > 0 ? static_cast<std::size_t>(bytes) : kGuess;
}

/// Holds frames of one case, and knows whose turn it is.
class FrameRotation {
 public:
  FrameRotation(const BenchCase& which, PixelType pixel_type)
      : format_(bench_format(which, pixel_type)) {
    const std::size_t n = 2 + 2 * second_cache_bytes() / format_.bytes();
    for (std::size_t i = 0; i < n; ++i) frames_.push_back(draw(which, i + 1));
  }

  const FrameFormat& format() const { return format_; }
  std::size_t size() const { return frames_.size(); }
  void advance() { current_ = (current_ + 1) % frames_.size(); }
  FrameBuffer& current() const { return *frames_[current_]; }

 private:
  std::unique_ptr<FrameBuffer> draw(const BenchCase& which, std::uint64_t seed) const {
    auto frame = std::make_unique<FrameBuffer>(format_);
    const AlignedVector<std::byte> pixels =
        bench_pixels(make_bench_frame(which, BenchSlopes::kRandom, seed), format_);
    std::copy(pixels.begin(), pixels.end(), frame->data());
    frame->rows_ready = format_.rows;
    return frame;
  }

  FrameFormat format_;
  std::vector<std::unique_ptr<FrameBuffer>> frames_;
  std::size_t current_ = 0;
};

/// Runs the plain loops over one case's frames.
template <typename Pixel>
class PlainLoops {
 public:
  PlainLoops(const BenchCase& which, const FrameRotation& frames, const PlainMaps& maps)
      : which_(which),
        frames_(frames),
        maps_(maps),
        x_(which.rows, which.cols),
        y_(x_),
        flux_(x_),
        column_sum_(2, which.cols * which.window_px) {}

  void find(PlainBuild build, PlainOrder order) {
    const PlainFrame<Pixel> frame{.rows = which_.rows,
                                  .cols = which_.cols,
                                  .window_px = which_.window_px,
                                  .pixels = frames_.current().view().template data<Pixel>(),
                                  .gain = maps_.gain.data(),
                                  .offset = maps_.offset.data()};
    find_plain_centroids(build, order, frame,
                         {x_.data(), y_.data(), flux_.data(), column_sum_.data()});
  }
  void read(PlainBuild build) {
    sum_ = sum_pixels(build, frames_.current().view().template data<Pixel>(),
                      static_cast<std::int64_t>(frames_.format().pixels()));
  }

 private:
  const BenchCase& which_;
  const FrameRotation& frames_;
  const PlainMaps& maps_;
  Image<float> x_;
  Image<float> y_;
  Image<float> flux_;
  Image<float> column_sum_;
  volatile std::uint64_t sum_ = 0;  // keeps the compiler from leaving the reading out
};

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

/// Returns the build that is fastest when nothing disturbs it, which the first tenth of the rounds
/// shows. It need not be the one of the widest vectors: they do not suit windows of a few pixels.
PlainBuild fastest_build(int rounds, const std::function<void(PlainBuild)>& run) {
  std::vector<PlainBuild> builds;
  std::vector<TimedRun> runs;
  for (const PlainBuild build : kPlainBuilds) {
    if (!can_run(build)) continue;
    builds.push_back(build);
    runs.push_back({{}, [&run, build] { run(build); }});
  }
  const std::vector<RoundTimes> times = time_in_turn(runs, rounds);
  const auto fastest = std::min_element(
      times.begin(), times.end(),
      [](const RoundTimes& a, const RoundTimes& b) { return a.p10_us < b.p10_us; });
  return builds[static_cast<std::size_t>(fastest - times.begin())];
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
  FrameRotation frames(which, pixel_type);
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

PlainMaps::PlainMaps(const Sensor& sensor, const FrameFormat& format, double threshold_adu)
    : gain(format.rows, format.cols), offset(format.rows, format.cols) {
  const double threshold = threshold_adu / format.scale_adu;
  for (std::size_t i = 0; i < gain.size(); ++i) {
    const auto response = static_cast<double>(sensor.flat[i]);
    const double dark =
        (static_cast<double>(sensor.dark_adu[i]) - format.zero_adu) / format.scale_adu;
    const bool bad = sensor.bad_pixel[i] != 0;
    gain[i] = bad ? 0.0F : static_cast<float>(1.0 / response);
    offset[i] = static_cast<float>(bad ? threshold : dark / response + threshold);
  }
}

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
