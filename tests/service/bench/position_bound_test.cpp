#include "service/bench/position_bound.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <array>
#include <cmath>
#include <complex>
#include <memory>
#include <vector>

#include "acquisition/simulator/field_vortices.h"
#include "acquisition/simulator/lenslet_optics.h"
#include "acquisition/simulator/random_stream.h"
#include "service/bench/position_benchmark.h"
#include "service/results/truth_match.h"
#include "tests/service/bench/small_field.h"
#include "tests/support/sanitized.h"
#include "tests/support/scratch_directory.h"

namespace curlew {
namespace {

constexpr int kSamples = 16;
constexpr std::uint64_t kSeed = 11;

/// Returns slope·[(x − x0) + i(y − y0)] over 2×2 lenslets, with a margin of one.
SampledField linear_vortex(double slope, double x0, double y0) {
  SampledField field;
  field.samples_per_lenslet = kSamples;
  field.margin_lenslets = 1;
  field.values = Image<std::complex<float>>(4 * kSamples, 4 * kSamples);
  for (int i = 0; i < field.values.rows(); ++i) {
    for (int j = 0; j < field.values.cols(); ++j) {
      const double x = (j + 0.5) / kSamples - 1.5;
      const double y = (i + 0.5) / kSamples - 1.5;
      field.values(i, j) = std::complex<float>(slope * std::complex<double>(x - x0, y - y0));
    }
  }
  return field;
}

/// Returns modes over 2×2 lenslets, as wide as given: 1, and with count 3 also x and y from the
/// node.
FieldModes simple_modes(int count, double deviation) {
  FieldModes modes{2, kSamples, 1.0, 1, {}};
  for (int lenslet = 0; lenslet < 4; ++lenslet) {
    Eigen::MatrixXcd values(kSamples * kSamples, count);
    for (int point = 0; point < kSamples * kSamples; ++point) {
      const double x = (point % kSamples + 0.5) / kSamples - (lenslet % 2 == 0 ? 1.0 : 0.0);
      const double y = (point / kSamples + 0.5) / kSamples - (lenslet / 2 == 0 ? 1.0 : 0.0);
      for (int k = 0; k < count; ++k)
        values(point, k) = deviation * (k == 0 ? 1.0 : k == 1 ? x : y);
    }
    modes.values.push_back(values);
  }
  return modes;
}

const std::vector<double> kFluxes{kWithoutNoise, 1e5, 1000.0, 200.0};

TEST(PixelInformation, IsThatOfPoissonAndReadNoise) {
  const PixelInformation without(0.0);
  EXPECT_NEAR(without(2.5), 0.4, 1e-12);
  for (const double sigma : {0.7, 1.0, 2.0}) {
    const PixelInformation information(sigma);
    EXPECT_NEAR(information(0.0), std::exp(1.0 / (sigma * sigma)) - 1.0,
                0.01 * information(0.0));  // the faintest entry of the table holds 1e-3 electrons
    for (const double mean : {0.03, 0.2, 1.0, 4.0, 20.0, 64.0, 500.0}) {
      EXPECT_LT(information(mean), 1.0 / mean);
      EXPECT_GT(information(mean), 0.99 / (mean + sigma * sigma)) << mean << ' ' << sigma;
    }
    EXPECT_NEAR(information(60.0) * (60.0 + sigma * sigma), 1.0, 0.03);
  }
}

TEST(SpotDerivative, IsTheSimulatorsLightAndItsDerivative) {
  const SpotDerivative spots(kSamples, 2.0, 6);
  LensletOptics optics(kSamples, 2.0, 6);
  RandomStream random(kSeed, 0);
  Eigen::MatrixXcd field(kSamples, kSamples), change(kSamples, kSamples);
  for (auto* each : {&field, &change})
    for (Eigen::Index k = 0; k < each->size(); ++k)
      each->data()[k] = {random.gaussian(), random.gaussian()};
  Eigen::VectorXd light;
  Eigen::MatrixXcd gradient;
  spots.linearise(field, light, gradient);
  const auto propagate = [&](const Eigen::MatrixXcd& of) {
    Image<std::complex<double>> image(kSamples, kSamples);
    for (int i = 0; i < kSamples; ++i)
      for (int j = 0; j < kSamples; ++j) image(i, j) = of(i, j);
    Image<double> patch(6, 6);
    optics.propagate(image, patch);
    return patch;
  };
  const Image<double> at = propagate(field), plus = propagate(field + change),
                      minus = propagate(field - change);
  for (int p = 0; p < 36; ++p) {
    std::complex<double> sum = 0.0;
    for (int i = 0; i < kSamples; ++i)
      for (int j = 0; j < kSamples; ++j) sum += gradient(p, i * kSamples + j) * change(i, j);
    const auto k = static_cast<std::size_t>(p);
    EXPECT_NEAR(light(p), at[k], 1e-12);
    // Exact, because light is quadratic.
    EXPECT_NEAR(sum.real(), 0.5 * (plus[k] - minus[k]), 1e-12);
  }
}

// Only the place is unknown: u = s[(x + iy) − c]. With fine pixels, all light seen and no read
// noise, a lenslet has the information 4N∫(Re e^(−iφ)Ê₁)² on Re c, and the same with Im on Im c,
// where φ is the far field's phase and ∫|Ê₁|² = 1. Together this is 4N, so four lenslets have 16N,
// which is 8N on either part by symmetry. So the rms distance is √(2/8N)/s = 1/(2s√N).
TEST(PositionBound, OfALinearCoreIsOneOverTwiceSlopeAndRootOfPhotons) {
  for (const double slope : {1.0, 0.3}) {
    const GradedVortex vortex{0.5 + 1e-9, 0.5 + 1e-9, 1};
    const SpotDerivative spots(kSamples, 6.0, 96);
    const VortexView view =
        view_vortex(linear_vortex(slope, 0.5, 0.5), vortex, 2, 2, simple_modes(1, 100.0), spots);
    const Eigen::Matrix2d covariance =
        position_covariances(view, 2, {1000.0}, PixelInformation(0.0)).front();
    const double expected = 1.0 / (4.0 * slope * slope * 1000.0);
    // Pixels take a little away, and the prior adds next to nothing.
    EXPECT_GT(covariance.trace(), 0.999 * expected);
    EXPECT_LT(covariance.trace(), 1.05 * expected);
    EXPECT_NEAR(covariance(0, 0), covariance(1, 1), 1e-6 * expected);
    EXPECT_NEAR(covariance(0, 1), 0.0, 1e-6 * expected);
  }
}

// Nothing is seen, so only the prior is left, which moves the zero by deviation·amplitude/slope.
TEST(PositionBound, WithoutLightIsThePrior) {
  const SpotDerivative spots(kSamples, 2.0, 6);
  const VortexView view =
      view_vortex(linear_vortex(1.0, 0.5, 0.5), {0.5, 0.5, 1}, 2, 2, simple_modes(1, 0.1), spots);
  const Eigen::Matrix2d covariance =
      position_covariances(view, 2, {1e-6}, PixelInformation(1.0)).front();
  const double moved = 0.1 * view.amplitude;
  EXPECT_NEAR(view.amplitude, std::sqrt(2.0 / 3.0), 0.01);  // mean of x² + y² over ±1
  EXPECT_NEAR(covariance(0, 0), moved * moved, 1e-6);
  EXPECT_NEAR(covariance(1, 1), moved * moved, 1e-6);
}

/// The maximum of the likelihood, found by Gauss and Newton, reaches the bound if light is plenty.
TEST(PositionBound, IsReachedByMaximumLikelihood) {
  if (kSanitized) GTEST_SKIP() << "a matter of statistics; the tests beside it run the same code";
  constexpr double kPhotons = 20000.0;
  constexpr int kTrials = 250;
  const double x0 = 0.62, y0 = 0.41;
  const GradedVortex vortex{x0, y0, 1};
  const FieldModes modes = simple_modes(3, 3.0);
  const SpotDerivative spots(kSamples, 2.0, 6);
  const SampledField field = linear_vortex(1.0, x0, y0);
  const VortexView truth = view_vortex(field, vortex, 2, 2, modes, spots);
  const double bound =
      position_covariances(truth, 2, {kPhotons}, PixelInformation(1.0)).front().trace();
  double squares = 0.0;
  for (int trial = 0; trial < kTrials; ++trial) {
    RandomStream random(kSeed, static_cast<std::uint64_t>(trial));
    Eigen::VectorXd counts(truth.light.size());
    for (Eigen::Index p = 0; p < counts.size(); ++p)
      counts(p) = random.poisson(kPhotons * truth.light(p)) + random.gaussian();
    // The field is constant + x·along_x + y·along_y, with x and y from the node.
    std::array<std::complex<double>, 3> c{
        std::complex<double>(0.5 - x0, 0.5 - y0), {1.0, 0.0}, {0.0, 1.0}};
    for (int step = 0; step < 3; ++step) {
      SampledField now = field;
      for (int i = 0; i < now.values.rows(); ++i) {
        for (int j = 0; j < now.values.cols(); ++j) {
          const double x = (j + 0.5) / kSamples - 2.0;
          const double y = (i + 0.5) / kSamples - 2.0;
          now.values(i, j) = std::complex<float>(c[0] + x * c[1] + y * c[2]);
        }
      }
      const VortexView view = view_vortex(now, vortex, 2, 2, modes, spots);
      const Eigen::ArrayXd mean = kPhotons * view.light.array();
      const Eigen::VectorXd weight = (mean + 1.0).inverse();
      const Eigen::MatrixXd a = kPhotons * view.derivative;
      const Eigen::MatrixXd precision =
          a.transpose() * weight.asDiagonal() * a + Eigen::MatrixXd::Identity(6, 6);
      const Eigen::VectorXd gradient =
          a.transpose() * (weight.array() * (counts.array() - mean)).matrix();
      const Eigen::VectorXd change = view.amplitude * 3.0 * precision.inverse() * gradient;
      for (std::size_t k = 0; k < 3; ++k) {
        const auto re = static_cast<Eigen::Index>(k);
        c[k] += std::complex<double>(change(re), change(re + 3));
      }
    }
    Eigen::Matrix2d slope;
    slope << c[1].real(), c[2].real(), c[1].imag(), c[2].imag();
    const Eigen::Vector2d at = -slope.inverse() * Eigen::Vector2d(c[0].real(), c[0].imag());
    squares += (at - Eigen::Vector2d(x0 - 0.5, y0 - 0.5)).squaredNorm();
  }
  // A mean of 250 squares of two deviates each may be 4 of its σ off, which is √(1/250)·√(up to 2).
  EXPECT_NEAR(squares / kTrials / bound, 1.0, 4.0 * std::sqrt(1.5 / kTrials)) << "seed " << kSeed;
}

TEST(TruncatedError, IsClosedForACircleAndTheWholeFarOut) {
  Eigen::Matrix2d circle = 0.09 * Eigen::Matrix2d::Identity();
  const double t = 0.5 * 0.75 * 0.75 / 0.09;
  const TruncatedError error = truncate_error(circle, 0.75);
  EXPECT_NEAR(error.probability, 1.0 - std::exp(-t), 1e-9);
  EXPECT_NEAR(error.square, 0.18 * (1.0 - (1.0 + t) * std::exp(-t)) / (1.0 - std::exp(-t)), 1e-9);
  Eigen::Matrix2d ellipse;
  ellipse << 0.5, 0.2, 0.2, 0.1;
  EXPECT_NEAR(truncate_error(ellipse, 100.0).square, 0.6, 1e-6);
  EXPECT_NEAR(truncate_error(ellipse, 100.0).probability, 1.0, 1e-9);
  // If the Gaussian is so wide that it is flat, the mean square in the circle is R²/2.
  EXPECT_NEAR(truncate_error(1e4 * circle, 0.75).square, 0.5 * 0.75 * 0.75, 1e-3);
}

class FieldModesOfTurbulence : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    FieldParameters wide = small_field(4.0, 16);
    wide.rows = wide.cols = 56;
    FieldModeEstimator estimator(6, kSamples, 10);
    const SampledField field = simulate_true_field(wide, realisation_seed(Subset::kTraining, 2));
    estimator.add(field, grade_vortices(find_field_vortices(field)), 56, 56);
    modes_ = std::make_unique<FieldModes>(estimator.modes(40));
  }
  static void TearDownTestSuite() { modes_.reset(); }
  static std::unique_ptr<FieldModes> modes_;
};
std::unique_ptr<FieldModes> FieldModesOfTurbulence::modes_;

TEST_F(FieldModesOfTurbulence, AreOrthogonalByFallingStrengthAndHoldNearlyAll) {
  ASSERT_EQ(modes_->values.size(), 36U);
  ASSERT_EQ(modes_->count(), 40);
  EXPECT_GT(modes_->patches, 20);
  Eigen::MatrixXcd products = Eigen::MatrixXcd::Zero(40, 40);
  for (const Eigen::MatrixXcd& values : modes_->values)
    products += values.adjoint() * values / (36.0 * kSamples * kSamples);
  // Each part of a coefficient has variance 1, so a mode gives twice its mean square.
  EXPECT_NEAR(2.0 * products.trace().real(), modes_->power, 1e-9);
  EXPECT_GT(modes_->power, 0.9);
  EXPECT_LE(modes_->power, 1.0 + 1e-9);
  for (int k = 0; k < 40; ++k) {
    if (k > 0) {
      EXPECT_LE(products(k, k).real(), products(k - 1, k - 1).real() * (1 + 1e-9));
    }
    for (int l = 0; l < k; ++l) EXPECT_LT(std::abs(products(k, l)), 1e-9);
  }
}

TEST_F(FieldModesOfTurbulence, BoundSeesTheBenchmarksLightAndFallsWithLightAndLenslets) {
  const FieldParameters field = small_field(4.0, 16);
  const SpotDerivative spots(kSamples, field.samples_per_lambda_w, field.window_px);
  const PixelInformation information(1.0);
  const Interior interior{16, 16};
  int seen = 0;
  int negative = 0;
  for (const int index : {5, 6}) {
    const std::uint64_t seed = realisation_seed(Subset::kTraining, index);
    const Realisation realisation = simulate_realisation(field, seed);
    const SampledField true_field = simulate_true_field(field, seed);
    for (const GradedVortex& vortex : grade_vortices(realisation.vortices)) {
      if (!vortex.required || !interior.contains(vortex.x, vortex.y)) continue;
      ++seen;
      negative += vortex.charge < 0 ? 1 : 0;
      const VortexView view = view_vortex(true_field, vortex, 16, 16, *modes_, spots);
      // The first lenslet of the innermost ring is the upper left one of the node. If the patch is
      // mirrored, so are its spots, and it is the right one.
      const bool mirrored = vortex.charge < 0;
      const int row = static_cast<int>(std::floor(vortex.y)) * 6;
      const int col = (static_cast<int>(std::floor(vortex.x)) + (mirrored ? 1 : 0)) * 6;
      for (int p = 0; p < 36; ++p) {
        const int across = mirrored ? 5 - p % 6 : p % 6;
        EXPECT_NEAR(view.light(p),
                    static_cast<double>(realisation.light(row + p / 6, col + across)),
                    1e-6 + 1e-4 * view.light(p));
      }
      std::vector<double> traces;
      for (const int lenslets : {2, 4, 6}) {
        const auto covariances = position_covariances(view, lenslets, kFluxes, information);
        for (std::size_t k = 0; k < covariances.size(); ++k) {
          const double trace = covariances[k].trace();
          EXPECT_GE(covariances[k].determinant(), -1e-12);
          if (k > 0) {
            EXPECT_GT(trace, covariances[k - 1].trace());  // with less light
          }
          // More lenslets never raise the bound, except by rounding where there is no noise.
          if (lenslets > 2) {
            EXPECT_LE(trace, traces[k] * (1.0 + 1e-9) + 1e-8);
          }
        }
        traces.clear();
        for (const Eigen::Matrix2d& covariance : covariances) traces.push_back(covariance.trace());
      }
      EXPECT_LT(traces.front(), 1e-3);  // 40 complex modes, 36 spots of 36 pixels, no noise
    }
  }
  EXPECT_GE(seen, 3);
  EXPECT_GE(negative, 1);
  EXPECT_LT(negative, seen);
}

TEST(PositionBenchmark, GivesABoundBelowTheClassifierWhateverTheThreads) {
  PositionBenchmarkOptions options;
  options.rytov_variances = {4.0};
  options.photons = {1000.0};
  options.test_realisations = options.validation_realisations = 2;
  options.training_realisations = 2;
  options.polynomials = 8;
  options.modes = 30;
  options.bootstrap_samples = 20;
  const ScratchDirectory scratch;
  const RealisationCache cache(scratch / "cache");
  int steps = 0;
  const auto cells = run_position_benchmark(options, cache, [&] { ++steps; });
  EXPECT_EQ(steps, 8);
  ASSERT_EQ(cells.size(), 1U);
  const PositionCellResult& cell = cells.front();
  EXPECT_GT(cell.score.hits, 4);
  EXPECT_LE(cell.score.hits, cell.score.vortices);
  EXPECT_EQ(cell.samples.size(), 20U);
  for (const PositionScore::Bound& bound : cell.score.bounds) {
    EXPECT_GT(bound.hits, 0.01);
    EXPECT_LT(bound.hits, cell.score.rms);
    EXPECT_LE(bound.hits, bound.uncut);
    EXPECT_LE(bound.within, 1.0);
  }
  EXPECT_LE(cell.score.bounds[1].uncut, cell.score.bounds[0].uncut);
  int in_classes = 0;
  for (const PositionClass& kind : cell.classes) in_classes += kind.score.vortices;
  // Each vortex has a class by light, by neighbour and by place.
  EXPECT_EQ(in_classes, 3 * cell.score.vortices);
  if (kSanitized) return;  // The same work again.
  options.threads = 2;
  const auto again = run_position_benchmark(options, cache, [] {});
  EXPECT_EQ(again[0].score.rms, cell.score.rms);
  EXPECT_EQ(again[0].score.bounds[1].uncut, cell.score.bounds[1].uncut);
}

}  // namespace
}  // namespace curlew
