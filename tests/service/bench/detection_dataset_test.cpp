#include "service/bench/detection_dataset.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>

#include "acquisition/simulator/simulator.h"
#include "service/bench/detection_benchmark.h"
#include "service/bench/detection_rows.h"
#include "tests/service/bench/small_field.h"
#include "tests/support/scratch_directory.h"

namespace curlew {
namespace {

template <typename T>
bool same_bytes(const Image<T>& a, const Image<T>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0;
}

bool same(const Realisation& a, const Realisation& b) {
  if (a.vortices.size() != b.vortices.size() || !same_bytes(a.light, b.light)) return false;
  for (std::size_t i = 0; i < a.vortices.size(); ++i) {
    if (a.vortices[i].x != b.vortices[i].x || a.vortices[i].y != b.vortices[i].y ||
        a.vortices[i].charge != b.vortices[i].charge)
      return false;
  }
  return true;
}

TEST(Realisations, SubsetsShareNoSeed) {
  const std::uint64_t last_training = realisation_seed(Subset::kTraining, 999'999);
  const std::uint64_t last_validation = realisation_seed(Subset::kValidation, 999'999);
  EXPECT_LT(last_training, realisation_seed(Subset::kValidation, 0));
  EXPECT_LT(last_validation, realisation_seed(Subset::kTest, 0));
  EXPECT_ANY_THROW(realisation_seed(Subset::kTest, 1'000'000));
}

TEST(Realisations, OneSeedOneFieldAlsoThroughTheCache) {
  const ScratchDirectory scratch;
  const FieldParameters parameters = small_field(4.0, 8);
  const std::uint64_t seed = realisation_seed(Subset::kTraining, 0);
  const Realisation made = simulate_realisation(parameters, seed);
  ASSERT_GT(made.vortices.size(), 3U) << "seed " << seed;
  const RealisationCache cache(scratch / "deep/folder");
  EXPECT_FALSE(cache.holds(parameters, seed));
  EXPECT_TRUE(same(cache.read_or_simulate(parameters, seed), made));
  EXPECT_TRUE(cache.holds(parameters, seed));
  EXPECT_TRUE(same(cache.read_or_simulate(parameters, seed), made));
  EXPECT_FALSE(cache.holds(parameters, seed + 1));
  EXPECT_FALSE(cache.holds(small_field(2.0, 8), seed));
  EXPECT_FALSE(same(simulate_realisation(parameters, seed + 1), made));
  // A file that was cut off is made again.
  const std::string file = (std::filesystem::directory_iterator(scratch / "deep/folder"))->path();
  const std::string whole = read_bytes(file);
  write_bytes(file, whole.substr(0, whole.size() / 2));
  EXPECT_TRUE(same(cache.read_or_simulate(parameters, seed), made));
  EXPECT_EQ(read_bytes(file), whole);
}

TEST(Realisations, WithoutTurbulenceToSpeakOfThereIsNoTruth) {
  const std::uint64_t seed = realisation_seed(Subset::kTraining, 1);
  const FieldParameters parameters = small_field(0.05, 8);
  const Realisation realisation = simulate_realisation(parameters, seed);
  EXPECT_TRUE(realisation.vortices.empty()) << "seed " << seed;
  // The detector must not be sure of anything either: a vortex on a node would show a D of 3.
  MeasurementOptions options;
  options.photons = kWithoutNoise;
  const MeasurementPlan plan(parameters, options);
  MeasuredFrame frame(plan);
  measure_frame(plan, realisation, seed, frame);
  for (const Candidate& candidate : make_detector_rows(plan).front().find(frame))
    EXPECT_LT(candidate.score, 0.3);
}

TEST(Measurement, SameBitsForSameSeedAndFluxesShareTheField) {
  const FieldParameters parameters = small_field(2.0, 8);
  const std::uint64_t seed = realisation_seed(Subset::kTraining, 2);
  const Realisation realisation = simulate_realisation(parameters, seed);
  MeasurementOptions options;
  options.photons = 1e5;
  const MeasurementPlan bright(parameters, options);
  MeasuredFrame a(bright), b(bright);
  measure_frame(bright, realisation, seed, a);
  measure_frame(bright, realisation, seed, b);
  EXPECT_TRUE(same_bytes(a.slopes.x, b.slopes.x));
  measure_frame(bright, realisation, seed + 1, b);
  EXPECT_FALSE(same_bytes(a.slopes.x, b.slopes.x));
  // With many photons the measured slopes are nearly those without noise.
  options.photons = kWithoutNoise;
  const MeasurementPlan clean(parameters, options);
  MeasuredFrame c(clean);
  measure_frame(clean, realisation, seed, c);
  double difference = 0.0, power = 0.0;
  for (std::size_t k = 0; k < a.slopes.x.size(); ++k) {
    difference += std::pow(static_cast<double>(a.slopes.x[k] - c.slopes.x[k]), 2);
    power += std::pow(static_cast<double>(c.slopes.x[k]), 2);
    EXPECT_NEAR(static_cast<double>(a.centroids.flux_adu[k]) / bright.flux_unit_adu(),
                static_cast<double>(c.centroids.flux_adu[k]) / clean.flux_unit_adu(), 0.02);
  }
  EXPECT_LT(difference, 0.01 * power);
}

// A tilt of s rad a pitch must come out as s, whatever window, flux and threshold take away.
TEST(Measurement, SlopesAreInRadiansPerPitch) {
  for (const double photons : {kWithoutNoise, 2e4}) {
    FieldParameters parameters = small_field(0.0, 8);
    MeasurementOptions options;
    options.photons = photons;
    const MeasurementPlan plan(parameters, options);
    // Gain of a window of ±1.5 λ/w.
    EXPECT_NEAR(static_cast<double>(plan.sensor().gain_x[0]), 0.852, 0.02);
    SimulatorOptions tilted = simulator_options(parameters, 1);
    tilted.turbulence.reset();
    tilted.scene.tilt_x_rad = 0.2;
    tilted.scene.tilt_y_rad = -0.1;
    Simulator simulator(tilted);
    MeasuredFrame frame(plan);
    measure_frame(plan, {simulator.expected_image_e(0), {}}, 1, frame);
    double x = 0.0, y = 0.0;
    for (std::size_t k = 0; k < frame.slopes.x.size(); ++k) {
      x += static_cast<double>(frame.slopes.x[k]) / static_cast<double>(frame.slopes.x.size());
      y += static_cast<double>(frame.slopes.y[k]) / static_cast<double>(frame.slopes.x.size());
    }
    EXPECT_NEAR(x, 0.2, 0.01) << photons;
    EXPECT_NEAR(y, -0.1, 0.01) << photons;
  }
}

TEST(Measurement, DarkLensletsAreFilledWithNothingKnown) {
  const FieldParameters parameters = small_field(0.0, 8);
  MeasurementOptions options;
  options.photons = 200.0;
  const MeasurementPlan plan(parameters, options);
  MeasuredFrame frame(plan);
  const Realisation dark{Image<float>(48, 48), {}};
  measure_frame(plan, dark, 1, frame);
  EXPECT_EQ(frame.slopes.n_valid, 64);
  EXPECT_EQ(frame.circulation.n_valid, 49);
  int missing = 0;
  for (std::size_t k = 0; k < frame.slopes.x.size(); ++k) {
    if (frame.centroids.state[k] == LensletState::kValid) continue;
    ++missing;
    EXPECT_EQ(frame.slopes.x[k], 0.0F);
    EXPECT_GT(frame.slopes.variance_x[k], 20.0F);
  }
  EXPECT_GT(missing, 20) << "read noise alone rarely exceeds the threshold of three read noises";
}

TEST(DetectionRows, EveryOneFindsAnIsolatedVortex) {
  const FieldParameters parameters = small_field(0.0, 8);
  MeasurementOptions options;
  options.photons = kWithoutNoise;
  const MeasurementPlan plan(parameters, options);
  for (const int charge : {1, -1}) {
    SimulatorOptions scene = simulator_options(parameters, 1);
    scene.turbulence.reset();
    scene.scene.vortices = {{3.3, 3.8, charge, 0.0, 0.0}};
    scene.scene.vortex_amplitude = VortexAmplitude::kLinearCore;
    Simulator simulator(scene);
    MeasuredFrame frame(plan);
    measure_frame(plan, {simulator.expected_image_e(0), {}}, 1, frame);
    for (const DetectorRow& row : make_detector_rows(plan)) {
      const std::vector<Candidate> found = row.find(frame);
      ASSERT_FALSE(found.empty()) << row.name;
      const Candidate& best =
          *std::max_element(found.begin(), found.end(),
                            [](const auto& a, const auto& b) { return a.score < b.score; });
      EXPECT_EQ(best.charge, charge) << row.name;
      EXPECT_LT(std::hypot(best.x - 3.3, best.y - 3.8), 0.75) << row.name;
    }
  }
}

TEST(DetectionBenchmark, ThreadsAndInterruptionsChangeNothing) {
  const ScratchDirectory scratch;
  const RealisationCache cache(scratch.path());
  DetectionBenchmarkOptions options;
  options.field = small_field(0.0, 8);
  options.rytov_variances = {4.0};
  options.photons = {kWithoutNoise, 1000.0};
  options.test_realisations = 3;
  options.validation_realisations = 2;
  options.bootstrap_samples = 20;
  int steps = 0;
  struct Stop {};
  EXPECT_THROW(run_detection_benchmark(options, cache,
                                       [&] {
                                         if (++steps == 3) throw Stop();
                                       }),
               Stop);
  EXPECT_EQ(scratch.names().size(), 3U);
  const auto alone = run_detection_benchmark(options, cache, [&] { ++steps; });
  EXPECT_EQ(steps, 3 + 5);
  options.threads = 3;
  const auto together = run_detection_benchmark(options, RealisationCache(""), [] {});
  ASSERT_EQ(alone.size(), 2U);
  EXPECT_EQ(alone[0].required, alone[1].required) << "both fluxes see the same field";
  EXPECT_GT(alone[0].required, 0);
  for (std::size_t cell = 0; cell < alone.size(); ++cell) {
    for (std::size_t row = 0; row < alone[cell].rows.size(); ++row) {
      const DetectionRowResult& a = alone[cell].rows[row];
      const DetectionRowResult& b = together[cell].rows[row];
      EXPECT_EQ(a.threshold, b.threshold);
      for (const ScoreMember& member : kScoreMembers) {
        const double value = a.score.*member.value;
        if (std::isnan(value)) continue;
        EXPECT_EQ(value, b.score.*member.value) << a.name << " " << member.name;
      }
    }
  }
  EXPECT_GT(alone[0].rows[0].score.average_precision, 0.3)
      << "|D| without noise must find vortices";
}

}  // namespace
}  // namespace curlew
