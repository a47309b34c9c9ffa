#include "service/bench/phase_benchmark.h"

#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <filesystem>
#include <random>

#include "reconstruct/hidden_phase.h"
#include "service/bench/phase_exponential.h"
#include "service/bench/phase_strehl.h"
#include "tests/service/bench/small_field.h"
#include "tests/support/allocation_counter.h"
#include "tests/support/scratch_directory.h"

namespace curlew {
namespace {

TEST(PhaseField, IsTheFieldThatTheLightIsMadeOf) {
  const FieldParameters parameters = small_field(2.0, 8);
  const std::uint64_t seed = realisation_seed(Subset::kTraining, 3);
  const PhaseField field = simulate_phase_field(parameters, seed);
  const Realisation realisation = simulate_realisation(parameters, seed);
  const int n = field.samples_per_lenslet;
  ASSERT_EQ(field.values.rows(), 8 * n);
  EXPECT_NEAR(field.coordinate(n) - field.coordinate(0), 1.0, 1e-12);
  EXPECT_NEAR(field.coordinate(0), -0.5 + 0.5 / n, 0.5 / n);
  double all_light = 0.0;
  double all_power = 0.0;
  for (int r = 0; r < 8; ++r) {
    for (int c = 0; c < 8; ++c) {
      double power = 0.0;
      double light = 0.0;
      for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j)
          power += static_cast<double>(std::norm(field.values(r * n + i, c * n + j))) / (n * n);
      const int w = parameters.window_px;
      for (int i = 0; i < w; ++i)
        for (int j = 0; j < w; ++j)
          light += static_cast<double>(realisation.light(r * w + i, c * w + j));
      // The window holds a part of the lenslet's light, and n points along a side are not quite its
      // mean.
      EXPECT_LT(light, 1.05 * power + 0.01) << "seed " << seed << " lenslet " << r << ' ' << c;
      all_light += light;
      all_power += power;
    }
  }
  EXPECT_GT(all_light, 0.6 * all_power);
}

TEST(PhaseField, ComesBackFromTheCache) {
  const ScratchDirectory scratch;
  const FieldParameters parameters = small_field(1.0, 8);
  const std::uint64_t seed = realisation_seed(Subset::kTraining, 4);
  const PhaseFieldCache cache(scratch / "fields");
  EXPECT_FALSE(cache.holds(parameters, seed));
  const PhaseField made = cache.read_or_simulate(parameters, seed);
  EXPECT_TRUE(cache.holds(parameters, seed));
  EXPECT_FALSE(cache.holds(small_field(2.0, 8), seed));
  const auto expect_same = [&](const PhaseField& read) {
    EXPECT_EQ(read.samples_per_lenslet, made.samples_per_lenslet);
    EXPECT_EQ(read.first, made.first);
    EXPECT_TRUE(std::equal(read.values.begin(), read.values.end(), made.values.begin()));
  };
  expect_same(cache.read_or_simulate(parameters, seed));
  const std::string file = std::filesystem::directory_iterator(scratch / "fields")->path();
  write_bytes(file, read_bytes(file).substr(0, 3000));  // a file that was cut off is made again
  expect_same(cache.read_or_simulate(parameters, seed));
}

/// The field is exp(iφ) at 8 points a lenslet, where φ is quadratic and has a vortex in its middle.
TEST(StrehlRatio, IsOneForTheFieldsOwnPhase) {
  const int rows = 9;
  const auto smooth = [](double x, double y) { return 0.4 * x - 0.1 * y + 0.05 * x * y; };
  const PointVortex vortex{4.2F, 3.7F, 1.0F};
  PhaseField field{Image<std::complex<float>>(8 * rows, 8 * rows), 8, 0.5 / 8 - 0.5};
  PhaseEstimate estimate{Image<float>(rows, rows), Image<float>(rows, rows), {vortex}};
  for (int i = 0; i < 8 * rows; ++i) {
    for (int j = 0; j < 8 * rows; ++j) {
      const double x = field.coordinate(j);
      const double y = field.coordinate(i);
      const double phase = smooth(x, y) + std::atan2(y - static_cast<double>(vortex.y),
                                                     x - static_cast<double>(vortex.x));
      field.values(i, j) = std::complex<float>(std::polar(1.0 + 0.5 * std::sin(x), phase));
    }
  }
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < rows; ++c) {
      estimate.smooth(r, c) = static_cast<float>(smooth(c, r));
      estimate.rotational(r, c) =
          std::atan2(static_cast<float>(r) - vortex.y, static_cast<float>(c) - vortex.x);
    }
  }
  const Strehl whole = strehl_after(field, estimate);
  EXPECT_NEAR(whole.ideal, 1.0, 1e-5);
  EXPECT_LT(whole.mirror, 0.99);  // the mirror bridges the branch cut
  EXPECT_GT(whole.mirror, 0.8);
  const double alone = strehl_after(field, {estimate.smooth, {}, {}}).ideal;
  EXPECT_LT(alone, 0.1);
  EXPECT_LT(strehl_uncorrected(field), 0.3);
}

TEST(ComplexExponential, FindsAPairFromSlopesAlone) {
  SlopeField slopes(16, 16);
  Image<float> phase(16, 16);
  const std::vector<PointVortex> pair{{4.4F, 7.4F, 1.0F}, {10.6F, 8.6F, -1.0F}};
  evaluate_vortices(pair.data(), pair.size(), 0.2F, phase, slopes.x, slopes.y);
  const auto found = vortices_of_exponential(slopes, Image<float>(16, 16, 1.0F));
  ASSERT_EQ(found.size(), 2U);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(found[i].charge, pair[i].charge);
    EXPECT_LT(std::hypot(found[i].x - pair[i].x, found[i].y - pair[i].y), 1.0F);
  }
}

TEST(PhaseBenchmark, HiddenPhaseOfTheTrueVorticesGainsAndThreadsDoNotCount) {
  PhaseBenchmarkOptions options;
  options.field = small_field(4.0, 8);
  options.field.rows = options.field.cols = 12;
  options.rytov_variances = {4.0};
  options.photons = {kWithoutNoise};
  options.realisations = 2;
  options.bootstrap_samples = 50;
  const ScratchDirectory scratch;
  const RealisationCache realisations(scratch / "cache");
  const PhaseFieldCache fields(scratch / "cache");
  int steps = 0;
  const auto cells = run_phase_benchmark(options, realisations, fields, [&] { ++steps; });
  EXPECT_EQ(steps, 2);
  ASSERT_EQ(cells.size(), 1U);
  const auto row = [&](const char* name) {
    for (const PhaseRowResult& r : cells[0].rows)
      if (r.name == name) return r;
    ADD_FAILURE() << name;
    return PhaseRowResult{};
  };
  EXPECT_GT(cells[0].true_vortices, 2.0);
  EXPECT_EQ(row(cells[0].baseline.c_str()).gain.value, 0.0);
  EXPECT_GT(row("hidden_true").gain.value, 0.1);
  EXPECT_GT(row("hidden").gain.value, 0.0);
  EXPECT_LE(row("hidden").strehl.interval.low, row("hidden").strehl.value);
  EXPECT_LE(row("hidden").strehl.value, row("hidden").strehl.interval.high);
  for (const PhaseRowResult& r : cells[0].rows) {
    EXPECT_GE(r.strehl.value, 0.0);
    EXPECT_LE(r.strehl.value, 1.0);
  }
  options.threads = 2;
  const auto again = run_phase_benchmark(options, realisations, fields, [] {});
  for (std::size_t i = 0; i < cells[0].rows.size(); ++i)
    EXPECT_EQ(again[0].rows[i].strehl.value, cells[0].rows[i].strehl.value);
}

TEST(NoAllocation, HiddenPhase) {
  if (!kCountsAllocations) GTEST_SKIP() << "the sanitizer owns malloc";
  const int n = 30;  // more than one tile
  Image<std::uint8_t> valid(n, n, 1);
  valid(12, 13) = valid(0, 0) = 0;
  for (const bool weighted : {false, true}) {
    SplitOptions split_options;
    split_options.weighted = weighted;
    const SplitPlan split_plan(valid, split_options);
    const HiddenPhasePlan plan(split_plan, {}, 16);
    HiddenPhaseWorkspace workspace(plan);
    SplitWorkspace split_workspace(split_plan);
    HodgeSplit split(n, n);
    Image<float> whole(n, n);
    Image<float> flux(n, n, 10.0F);
    SlopeField slopes(n, n);
    VortexList candidates(32);
    std::mt19937 random(8);
    std::normal_distribution<float> noise(0.0F, 0.3F);
    std::uniform_real_distribution<float> place(0.0F, 29.0F);
    std::size_t believed = 0;
    const long count = allocations_of_this_thread([&] {
      for (int frame = 0; frame < 30; ++frame) {
        candidates.clear();
        for (int v = 0; v < frame; ++v) {
          Vortex vortex;
          vortex.x = place(random);
          vortex.y = place(random);
          vortex.charge = v % 2 == 0 ? 1 : -1;
          vortex.probability = 0.95F;
          candidates.push(vortex);
        }
        for (std::size_t k = 0; k < valid.size(); ++k) {
          slopes.valid[k] = k % 37 == 5 && frame % 2 == 0 ? std::uint8_t{0} : valid[k];
          slopes.x[k] = slopes.valid[k] != 0 ? noise(random) : 0.0F;
          slopes.y[k] = slopes.valid[k] != 0 ? noise(random) : 0.0F;
          slopes.variance_x[k] = slopes.variance_y[k] = 0.1F;
        }
        split_slopes(split_plan, slopes, split_workspace, split);
        add_hidden_phase(plan, candidates, slopes, flux, split, split_workspace, workspace, whole);
        believed += workspace.vortices.size();
      }
    });
    EXPECT_EQ(count, 0);
    EXPECT_GT(believed, 0U);
  }
}

}  // namespace
}  // namespace curlew
