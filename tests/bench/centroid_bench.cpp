// Pixels to centroids on the frames of PEERS.md, beside a plain-C centre of gravity timed in the
// same run, turn by turn. One thread. Prints a table: µs a frame (median and best) and ratios.
#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <string>
#include <vector>

#include "centroiding/centroid.h"
#include "centroiding/slopes.h"
#include "service/bench/bench_frames.h"

namespace {

// The baseline: Σ, Σx, Σy over each window above a scalar dark. The same text compiled for any
// x86-64 at -O3, and for AVX-512 with -ffast-math ("best flags").
#define CURLEW_PLAIN_LOOP(name, attributes)                                              \
  attributes void name(const std::uint16_t* pixels, int n, int p, float dark, float* xs, \
                       float* ys) {                                                      \
    for (int r = 0; r < n; ++r) {                                                        \
      for (int c = 0; c < n; ++c) {                                                      \
        const std::uint16_t* window = pixels + (r * p) * (n * p) + c * p;                \
        float sum = 0, sum_x = 0, sum_y = 0;                                             \
        for (int y = 0; y < p; ++y) {                                                    \
          for (int x = 0; x < p; ++x) {                                                  \
            const float v = static_cast<float>(window[y * (n * p) + x]) - dark;          \
            sum += v;                                                                    \
            sum_x += v * static_cast<float>(x);                                          \
            sum_y += v * static_cast<float>(y);                                          \
          }                                                                              \
        }                                                                                \
        xs[r * n + c] = sum_x / sum;                                                     \
        ys[r * n + c] = sum_y / sum;                                                     \
      }                                                                                  \
    }                                                                                    \
  }

CURLEW_PLAIN_LOOP(plain_c, __attribute__((noinline, optimize("O3"))))
#if defined(__x86_64__)
CURLEW_PLAIN_LOOP(plain_c_best, __attribute__((noinline, optimize("O3", "fast-math"),
                                               target("avx512f,avx512bw,avx512vl,avx512dq,fma"))))
bool has_best() { return __builtin_cpu_supports("avx512bw") != 0; }
#else
CURLEW_PLAIN_LOOP(plain_c_best, __attribute__((noinline, optimize("O3", "fast-math"))))
bool has_best() { return true; }
#endif

struct Timing {
  double median_us = 0;
  double best_us = 0;
};

/// Runs all of them in turn, `rounds` times.
std::vector<Timing> time_interleaved(const std::vector<std::function<void()>>& runs, int rounds) {
  std::vector<std::vector<double>> us(runs.size());
  for (int round = -rounds / 10; round < rounds; ++round) {
    for (std::size_t i = 0; i < runs.size(); ++i) {
      const auto start = std::chrono::steady_clock::now();
      runs[i]();
      const std::chrono::duration<double, std::micro> took =
          std::chrono::steady_clock::now() - start;
      if (round >= 0) us[i].push_back(took.count());
    }
  }
  std::vector<Timing> timings;
  for (auto& list : us) {
    std::sort(list.begin(), list.end());
    timings.push_back({list[list.size() / 2], list.front()});
  }
  return timings;
}

}  // namespace

int main() {
#ifndef NDEBUG
  std::puts("refusing to measure a debug build; configure with -DCMAKE_BUILD_TYPE=Release");
  return 1;
#endif
  std::printf("%-24s %30s %30s %30s\n", "", "(a) 40x40 of 6x6", "(b) 80x80 of 10x10",
              "(c) 30x30 of 32x32");
  const std::vector<std::string> names = {"plain C, -O3", "plain C, best flags", "curlew, no maps",
                                          "curlew, dark+flat+bad", "slopes"};
  std::vector<std::string> lines(names.begin(), names.end());
  for (auto& line : lines) line.resize(24, ' ');
  for (const auto& which : curlew::kBenchCases) {
    const curlew::BenchFrame frame =
        curlew::make_bench_frame(which, curlew::BenchSlopes::kRandom, 1);
    curlew::Sensor sensor = curlew::tiled_sensor(which);
    const curlew::CentroidOptions options{.threshold_adu = curlew::kBenchThresholdAdu};
    const curlew::CentroidPlan bare(sensor, frame.format, options);
    const curlew::SlopePlan slope_plan(sensor);
    curlew::add_maps(sensor, 2);
    const curlew::CentroidPlan mapped(sensor, frame.format, options);
    const int n = which.rows;
    const int p = which.window_px;
    curlew::Centroids centroids(n, n);
    curlew::SlopeField slopes(n, n);
    curlew::Image<float> xs(n, n), ys(n, n);
    const auto timings =
        time_interleaved({[&] { plain_c(frame.pixels.data(), n, p, 100.0F, xs.data(), ys.data()); },
                          [&] {
                            if (has_best())
                              plain_c_best(frame.pixels.data(), n, p, 100.0F, xs.data(), ys.data());
                          },
                          [&] { curlew::find_centroids(bare, frame.view(), centroids); },
                          [&] { curlew::find_centroids(mapped, frame.view(), centroids); },
                          [&] { curlew::measure_slopes(slope_plan, centroids, slopes); }},
                         1000);
    for (std::size_t i = 0; i < timings.size(); ++i) {
      char cell[64];
      std::snprintf(cell, sizeof cell, " %7.1f %7.1f us  x%.2f x%.2f", timings[i].median_us,
                    timings[i].best_us, timings[i].median_us / timings[0].median_us,
                    timings[i].median_us / timings[1].median_us);
      lines[i] += cell;
    }
  }
  for (const auto& line : lines) std::puts(line.c_str());
  std::puts("median, best; ratio of medians to plain C at -O3 and with best flags");

  std::puts("\nmethods, without maps: median us, ratio to thresholded");
  std::vector<std::string> methods(curlew::kCentroidMethodNames.begin(),
                                   curlew::kCentroidMethodNames.end());
  for (auto& line : methods) line.resize(24, ' ');
  for (const auto& which : curlew::kBenchCases) {
    const curlew::BenchFrame frame =
        curlew::make_bench_frame(which, curlew::BenchSlopes::kRandom, 1);
    curlew::Centroids centroids(which.rows, which.cols);
    std::vector<curlew::CentroidPlan> plans;
    for (std::size_t i = 0; i < methods.size(); ++i) {
      curlew::Sensor sensor = curlew::tiled_sensor(which);
      sensor.method = static_cast<curlew::CentroidMethod>(i);
      curlew::CentroidOptions options{.threshold_adu = curlew::kBenchThresholdAdu};
      options.method = sensor.method;
      plans.emplace_back(sensor, frame.format, options);
    }
    std::vector<std::function<void()>> runs;
    for (const auto& plan : plans)
      runs.emplace_back([&] { curlew::find_centroids(plan, frame.view(), centroids); });
    const auto timings = time_interleaved(runs, 100);
    for (std::size_t i = 0; i < methods.size(); ++i) {
      char cell[64];
      std::snprintf(cell, sizeof cell, " %9.1f us  x%5.2f       ", timings[i].median_us,
                    timings[i].median_us / timings[0].median_us);
      methods[i] += cell;
    }
  }
  for (const auto& line : methods) std::puts(line.c_str());
  return 0;
}
