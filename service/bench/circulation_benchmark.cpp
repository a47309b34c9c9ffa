#include "service/bench/circulation_benchmark.h"

#include <random>
#include <vector>

#include "core/slope_field.h"
#include "core/vortex.h"
#include "detect/circulation.h"
#include "detect/circulation_finder.h"
#include "detect/vortex_kernel.h"

namespace curlew {
namespace {

constexpr float kSlopeNoise = 0.2F;  // rad a pitch
constexpr std::size_t kCapacity = 1024;

SlopeField noise_with_vortices(int rows, int cols, int vortices) {
  SlopeField slopes(rows, cols);
  std::mt19937 random(1);
  std::normal_distribution<float> noise(0.0F, kSlopeNoise);
  for (std::size_t k = 0; k < slopes.x.size(); ++k) {
    slopes.x[k] = noise(random);
    slopes.y[k] = noise(random);
  }
  slopes.variance_x.fill(kSlopeNoise * kSlopeNoise);
  slopes.variance_y.fill(kSlopeNoise * kSlopeNoise);
  slopes.valid.fill(1);
  slopes.n_valid = rows * cols;
  const VortexKernel kernel;
  std::uniform_real_distribution<double> place_x(0.5, cols - 1.5);
  std::uniform_real_distribution<double> place_y(0.5, rows - 1.5);
  for (int v = 0; v < vortices; ++v) {
    const double x = place_x(random);
    const double y = place_y(random);
    const float charge = v % 2 == 0 ? 1.0F : -1.0F;
    for (int r = 0; r < rows; ++r) {
      for (int c = 0; c < cols; ++c) {
        const auto s = kernel.lenslet_slopes(c - x, r - y);
        slopes.x(r, c) += charge * static_cast<float>(s[0]);
        slopes.y(r, c) += charge * static_cast<float>(s[1]);
      }
    }
  }
  return slopes;
}

}  // namespace

CirculationBenchmark time_circulation(int rows, int cols, int vortices, int rounds) {
  const SlopeField slopes = noise_with_vortices(rows, cols, vortices);
  const CirculationPlan plan({}, slopes.valid, kCapacity);
  CirculationMap map(rows, cols);
  VortexList found(plan.capacity());
  const auto circulate_all = [&] { circulate(slopes, map); };
  const auto find_all = [&] { find_circulation_vortices(plan, map, found); };
  const auto both = [&] {
    circulate_all();
    find_all();
  };
  const std::vector<RoundTimes> times =
      time_in_turn({{{}, circulate_all}, {{}, find_all}, {{}, both}}, rounds);
  return {rows, cols, vortices, found.size(), times[0], times[1], times[2]};
}

}  // namespace curlew
