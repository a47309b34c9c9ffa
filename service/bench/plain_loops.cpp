#include "service/bench/plain_loops.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <utility>
#include <vector>

#include "service/bench/timed_rounds.h"

namespace curlew {

std::size_t second_cache_bytes() {
  constexpr std::size_t kGuess = std::size_t{2} << 20U;
  const long bytes = sysconf(_SC_LEVEL2_CACHE_SIZE);
  return bytes > 0 ? static_cast<std::size_t>(bytes) : kGuess;
}

FrameRotation::FrameRotation(const BenchCase& which, PixelType pixel_type, BenchSlopes slopes)
    : format_(bench_format(which, pixel_type)) {
  const std::size_t n = 2 + 2 * second_cache_bytes() / format_.bytes();
  for (std::size_t i = 0; i < n; ++i) {
    auto frame = std::make_shared<FrameBuffer>(format_);
    const AlignedVector<std::byte> pixels =
        bench_pixels(make_bench_frame(which, slopes, i + 1), format_);
    std::copy(pixels.begin(), pixels.end(), frame->data());
    frame->rows_ready = format_.rows;
    frames_.push_back(std::move(frame));
  }
}

FrameRotation FrameRotation::of_one_wavefront(const BenchCase& which) {
  FrameRotation rotation(which, PixelType::kU16, BenchSlopes::kSmooth);
  const FrameFormat& format = rotation.format_;
  const auto* light = reinterpret_cast<const std::uint16_t*>(rotation.frames_.front()->data());
  const std::vector<std::uint16_t> same(light, light + format.pixels());
  std::mt19937_64 random(1);
  std::normal_distribution<double> noise(0.0, kBenchNoiseAdu);
  for (const auto& frame : rotation.frames_) {
    auto* pixels = reinterpret_cast<std::uint16_t*>(frame->data());
    for (std::size_t i = 0; i < same.size(); ++i)
      pixels[i] = static_cast<std::uint16_t>(
          std::lround(std::clamp(same[i] + noise(random), 0.0, 65535.0)));
  }
  return rotation;
}

LoopSource FrameRotation::loop(std::size_t n, std::int64_t count) const {
  LoopSource::Frames some;
  for (std::size_t i = 0; i < std::min(n, frames_.size()); ++i) some.push_back(frames_[i]);
  return LoopSource(std::move(some), count);
}

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

}  // namespace curlew
