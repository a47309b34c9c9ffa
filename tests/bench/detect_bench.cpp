// Times circulation and vortex finding, one frame after another, on one thread.
#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <random>

#include "core/latency_histogram.h"
#include "core/slope_field.h"
#include "core/vortex.h"
#include "detect/circulation.h"
#include "detect/circulation_finder.h"
#include "detect/vortex_kernel.h"

namespace {

using Clock = std::chrono::steady_clock;

std::int64_t ns_between(Clock::time_point from, Clock::time_point to) {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(to - from).count();
}

void print(const char* what, const curlew::LatencyHistogram& times) {
  const auto us = [&](double fraction) {
    return 1e-3 * static_cast<double>(times.percentile_ns(fraction));
  };
  std::printf("  %-12s p50 %7.2f  p90 %7.2f  p99 %7.2f  p99.9 %7.2f  max %7.2f us\n", what, us(0.5),
              us(0.9), us(0.99), us(0.999), 1e-3 * static_cast<double>(times.max_ns()));
}

/// size×size lenslets, white slope noise of .2 rad per pitch, n_vortices round vortices.
void bench(int size, int n_vortices) {
  curlew::SlopeField slopes(size, size);
  std::mt19937 random(1);
  std::normal_distribution<float> noise(0.0F, 0.2F);
  std::uniform_real_distribution<double> place(1.0, size - 2.0);
  for (std::size_t k = 0; k < slopes.x.size(); ++k) {
    slopes.x[k] = noise(random);
    slopes.y[k] = noise(random);
  }
  slopes.variance_x.fill(0.04F);
  slopes.variance_y.fill(0.04F);
  slopes.valid.fill(1);
  slopes.n_valid = size * size;
  for (int v = 0; v < n_vortices; ++v) {
    const curlew::VortexKernel kernel;
    const double x = place(random);
    const double y = place(random);
    const float charge = v % 2 == 0 ? 1.0F : -1.0F;
    for (int r = 0; r < size; ++r) {
      for (int c = 0; c < size; ++c) {
        const auto s = kernel.lenslet_slopes(c - x, r - y);
        slopes.x(r, c) += charge * static_cast<float>(s[0]);
        slopes.y(r, c) += charge * static_cast<float>(s[1]);
      }
    }
  }

  const curlew::CirculationPlan plan({}, slopes.valid, 1024);
  curlew::CirculationMap map(size, size);
  curlew::VortexList vortices(plan.capacity());
  curlew::LatencyHistogram circulation;
  curlew::LatencyHistogram finding;
  curlew::LatencyHistogram both;
  for (int i = 0; i < 20000; ++i) {
    const auto start = Clock::now();
    curlew::circulate(slopes, map);
    const auto circulated = Clock::now();
    curlew::find_circulation_vortices(plan, map, vortices);
    const auto found = Clock::now();
    circulation.record(ns_between(start, circulated));
    finding.record(ns_between(circulated, found));
    both.record(ns_between(start, found));
  }
  std::printf("%dx%d lenslets, %d vortices put in, %zu found\n", size, size, n_vortices,
              vortices.size());
  print("circulation", circulation);
  print("finding", finding);
  print("both", both);
}

}  // namespace

int main() {
#ifndef NDEBUG
  std::fprintf(stderr, "detect_bench: build with NDEBUG; a debug build's times mean nothing\n");
  return 1;
#endif
  bench(16, 0);
  bench(16, 4);
  bench(80, 0);
  bench(80, 8);
  bench(80, 200);
  return 0;
}
