// These tests hold vortices seen through the simulated sensor against known values of D, and check
// the analytic slopes that other tests use.
#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "acquisition/simulator/simulator.h"
#include "tests/support/analytic_slopes.h"

namespace curlew {
namespace {

// Returns D of cell (r, c), by the formula of docs/conventions.md, from slopes as a function of
// (row, col).
template <typename Slope>
double circulation(const Slope& s, int r, int c) {
  const auto a = s(r, c);
  const auto b = s(r, c + 1);
  const auto d = s(r + 1, c + 1);
  const auto e = s(r + 1, c);
  return 0.5 * (a[0] + b[0] + b[1] + d[1] - d[0] - e[0] - e[1] - a[1]);
}

// Returns the circulation on a vortex's node as seen through spots: by the centre of gravity over
// the whole window of ±half_window λ/w, in double, without threshold or gain.
double simulated_circulation(VortexAmplitude amplitude, double half_window,
                             double pixels_per_lambda_w, SceneVortex vortex = {}) {
  SimulatorOptions options;
  options.rows = 4;
  options.cols = 4;
  options.samples_per_lambda_w = pixels_per_lambda_w;
  options.window_px = static_cast<int>(std::lround(2.0 * half_window * pixels_per_lambda_w));
  options.scene.vortex_amplitude = amplitude;
  vortex.x = 1.5;
  vortex.y = 1.5;
  options.scene.vortices.push_back(vortex);
  Simulator simulator(options);
  const Image<float>& image = simulator.expected_image_e();
  const int p = options.window_px;
  const auto slope = [&](int row, int col) {
    double sum = 0.0;
    double x = 0.0;
    double y = 0.0;
    for (int i = 0; i < p; ++i) {
      for (int j = 0; j < p; ++j) {
        const auto value = static_cast<double>(image(row * p + i, col * p + j));
        sum += value;
        x += value * (j - 0.5 * (p - 1));
        y += value * (i - 0.5 * (p - 1));
      }
    }
    const double rad = simulator.optics().slope_rad_per_px() / sum;
    return std::array<double, 2>{x * rad, y * rad};
  };
  return circulation(slope, 1, 1);
}

// The known values have two decimals (5e-3); 32 field samples per lenslet leave another 4e-3 (64
// leave 1e-3). They are for continuous windows, for which pixels of 1/8 λ/w stand.
constexpr double kPrinted = 0.01;

TEST(SimulatedVortex, LinearCoreThroughSpots) {
  constexpr auto kCore = VortexAmplitude::kLinearCore;
  EXPECT_NEAR(simulated_circulation(kCore, 1.0, 8.0), 3.18, kPrinted);
  EXPECT_NEAR(simulated_circulation(kCore, 1.5, 8.0), 2.66, kPrinted);
  EXPECT_NEAR(simulated_circulation(kCore, 2.0, 8.0), 3.08, kPrinted);
  EXPECT_NEAR(simulated_circulation(kCore, 4.0, 8.0), 3.04, kPrinted);
}

TEST(SimulatedVortex, UniformAmplitudeThroughSpots) {
  constexpr auto kUniform = VortexAmplitude::kUniform;
  EXPECT_NEAR(simulated_circulation(kUniform, 1.0, 8.0), 3.80, kPrinted);
  EXPECT_NEAR(simulated_circulation(kUniform, 1.5, 8.0), 3.44, kPrinted);
  EXPECT_NEAR(simulated_circulation(kUniform, 2.0, 8.0), 4.05, kPrinted);
  EXPECT_NEAR(simulated_circulation(kUniform, 4.0, 8.0), 4.23, kPrinted);
}

// This is the sensor of the benchmark, with pixels of .5 λ/w.
TEST(SimulatedVortex, PixelsOfHalfLambdaOverW) {
  EXPECT_NEAR(simulated_circulation(VortexAmplitude::kLinearCore, 4.0, 2.0), 3.05, 0.05);
  EXPECT_NEAR(simulated_circulation(VortexAmplitude::kUniform, 4.0, 2.0), 4.23, 0.05);
  // The mirrored field must have the opposite circulation, as precisely as the image's floats
  // allow.
  EXPECT_NEAR(simulated_circulation(VortexAmplitude::kLinearCore, 4.0, 2.0, {.charge = -1}),
              -simulated_circulation(VortexAmplitude::kLinearCore, 4.0, 2.0), 1e-4);
}

TEST(AnalyticSlopes, UniformMeanAtACorner) {
  const auto mean = mean_phase_gradient({.x = 0.5, .y = 0.5}, 0, 0);
  // The value is ±(π/4 + ln2/2), the paper's Eq. 13. The quadrature is right to 1e-13 per side.
  EXPECT_NEAR(mean[0], 1.131971753677421, 1e-12);
  EXPECT_NEAR(mean[1], -1.131971753677421, 1e-12);
}

double uniform_circulation(const TestVortex& vortex) {
  return circulation([&](int r, int c) { return mean_phase_gradient(vortex, r, c); }, 0, 0);
}

// The values, of 12 and of 9 decimals, are those of the paper's Eq. A1 for any position and
// morphology, some at its singular places. μ and ν are the cell's place seen from the vortex.
TEST(AnalyticSlopes, UniformMeanOfAnyVortex) {
  const auto d = [](double mu, double nu, double alpha, double beta) {
    return uniform_circulation(
        {.x = 0.5 - mu, .y = 0.5 - nu, .alpha_rad = alpha, .beta_rad = beta});
  };
  EXPECT_NEAR(d(0.3, 0.2, 0.7, 1.0), 3.079614607803, 1e-11);
  EXPECT_NEAR(d(-0.4, 0.9, 1.2, 2.5), 0.531910621304, 1e-11);
  EXPECT_NEAR(d(0.5, 0.5, 0.5, 5.5), 1.392803366873, 1e-11);
  EXPECT_NEAR(d(0.0, 0.0, 0.0, 0.0), 4.527887014709684, 1e-12);
  EXPECT_NEAR(d(1.0, 1.0, 0.0, 0.0), -0.3966410308617583, 1e-12);
  EXPECT_NEAR(d(0.971810, 1.0, 0.0, 0.0), -0.4107301049, 1e-9);
  EXPECT_NEAR(d(1.0, 0.0, 0.0, 0.0), 0.798362936, 1e-9);
  EXPECT_NEAR(d(0.5, 0.0, 0.0, 0.0), 2.930779664, 1e-9);
}

// A core of linear amplitude on a node has D = 3 exactly and a 3×3 sum of 5.7857.
TEST(AnalyticSlopes, LinearCoreOnANode) {
  const std::array<TestVortex, 1> vortex{TestVortex{.x = 2.5, .y = 2.5}};
  const auto slope = [&](int r, int c) { return weighted_phase_gradient(vortex, r, c); };
  EXPECT_NEAR(circulation(slope, 2, 2), 3.0, 1e-12);
  double sum = 0.0;
  for (int r = 1; r <= 3; ++r) {
    for (int c = 1; c <= 3; ++c) sum += circulation(slope, r, c);
  }
  EXPECT_NEAR(sum, 5.7857, 5e-5);
  // The values for stretched cores are known to two decimals.
  const std::array<TestVortex, 1> flat{
      TestVortex{.x = 2.5, .y = 2.5, .alpha_rad = 0.785398163, .beta_rad = 3.141592654}};
  EXPECT_NEAR(circulation([&](int r, int c) { return weighted_phase_gradient(flat, r, c); }, 2, 2),
              2.12, 0.006);
  const std::array<TestVortex, 1> sheared{
      TestVortex{.x = 2.5, .y = 2.5, .alpha_rad = 1.396263402, .beta_rad = 1.570796327}};
  EXPECT_NEAR(
      circulation([&](int r, int c) { return weighted_phase_gradient(sheared, r, c); }, 2, 2), 1.15,
      0.006);
}

TEST(AnalyticSlopes, FieldsAreWhollyValidAndRoundToFloat) {
  const std::array<TestVortex, 2> dipole{TestVortex{.x = 1.5, .y = 1.5},
                                         TestVortex{.x = 2.5, .y = 1.5, .charge = -1}};
  const SlopeField uniform = uniform_vortex_slopes(4, 5, dipole);
  const SlopeField linear = linear_core_slopes(4, 5, dipole);
  EXPECT_EQ(uniform.n_valid, 20);
  EXPECT_EQ(linear.n_valid, 20);
  const auto d = circulation(
      [&](int r, int c) {
        return std::array<double, 2>{static_cast<double>(uniform.x(r, c)),
                                     static_cast<double>(uniform.y(r, c))};
      },
      1, 1);
  EXPECT_NEAR(d, 3.730, 5e-4);  // This is a round dipole of separation 1.
}

}  // namespace
}  // namespace curlew
