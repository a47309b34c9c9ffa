#include <algorithm>
#include <random>

#include "reconstruct/hidden_phase.h"
#include "service/bench/bench_timing.h"
#include "service/bench/phase_benchmark.h"

namespace curlew {
namespace {

constexpr float kNoise = 0.2F;       // rad a pitch
constexpr float kSeparation = 2.0F;  // of a pair, in pitches

/// Places the true vortices with p = .8, and as many false ones with p = .2.
void place_vortices(int size, int n, std::mt19937& random, VortexList& candidates,
                    FixedList<PointVortex>& truth) {
  std::uniform_real_distribution<float> place(1.0F, static_cast<float>(size) - 2.0F - kSeparation);
  const auto add = [&](float x, float y, int charge, float probability) {
    Vortex vortex;
    vortex.x = x;
    vortex.y = y;
    vortex.charge = charge;
    vortex.probability = probability;
    candidates.push(vortex);
  };
  for (int i = 0; i < n; ++i) {
    const float x = place(random);
    const float y = place(random);
    const int charge = i % 2 == 0 ? 1 : -1;
    add(place(random), place(random), charge, 0.2F);
    if (i % 2 != 0) continue;
    for (const int sign : {1, -1}) {
      const float there = sign > 0 ? x : x + kSeparation;
      add(there, y, sign, 0.8F);
      truth.push({there, y, static_cast<float>(sign)});
    }
  }
}

}  // namespace

PhaseTiming time_hidden_phase(int size, int vortices, int frames) {
  const auto capacity = 2 * static_cast<std::size_t>(vortices) + 2;
  const Image<std::uint8_t> pupil(size, size, 1);
  const SplitPlan split_plan(pupil, {});
  const HiddenPhasePlan plan(split_plan, {}, capacity);
  HiddenPhaseWorkspace workspace(plan);
  SplitWorkspace split_workspace(split_plan);
  HodgeSplit split(size, size);
  SlopeField slopes(size, size);
  slopes.valid.fill(1);
  slopes.n_valid = size * size;
  Image<float> flux(size, size);
  Image<float> whole(size, size);
  VortexList candidates(capacity);
  FixedList<PointVortex> truth(capacity);
  std::mt19937 random(1);
  std::normal_distribution<float> noise(0.0F, kNoise);
  std::exponential_distribution<float> light(1e-3F);
  std::vector<double> whole_us, choice_us, field_us, cuts_us, split_us;
  for (int frame = 0; frame < frames; ++frame) {
    candidates.clear();
    truth.clear();
    place_vortices(size, vortices, random, candidates, truth);
    evaluate_vortices(truth.begin(), truth.size(), 0.2F, workspace.wrapped, slopes.x, slopes.y);
    for (std::size_t k = 0; k < flux.size(); ++k) {
      slopes.x[k] += noise(random);
      slopes.y[k] += noise(random);
      flux[k] = light(random);
    }
    split_us.push_back(time_us([&] { split_slopes(split_plan, slopes, split_workspace, split); }));
    whole_us.push_back(time_us([&] {
      add_hidden_phase(plan, candidates, slopes, flux, split, split_workspace, workspace, whole);
    }));
    choice_us.push_back(time_us([&] {
      choose_vortices(plan.choice(), candidates, slopes, workspace.choice, workspace.vortices);
    }));
    field_us.push_back(time_us([&] {
      evaluate_vortices(workspace.points.begin(), workspace.points.size(), plan.options().softening,
                        workspace.wrapped, workspace.vortex_slopes.x, workspace.vortex_slopes.y);
    }));
    cuts_us.push_back(time_us([&] {
      unwrap_with_cuts(workspace.wrapped, flux, slopes.valid, workspace.cuts, workspace.rotational);
    }));
  }
  return {size,
          vortices,
          median(whole_us),
          *std::min_element(whole_us.begin(), whole_us.end()),
          median(choice_us),
          median(field_us),
          median(cuts_us),
          median(split_us)};
}

}  // namespace curlew
