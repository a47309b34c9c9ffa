// These tests are about the whitened filter: its covariance, its statistic and its symmetries.
#include "detect/whitened/whitened_filter.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <random>

#include "core/vortex.h"
#include "detect/circulation.h"

namespace curlew {
namespace {

constexpr int kRows = 9;
constexpr int kCols = 11;
constexpr float kClutter = 0.7F;

struct Frame {
  Frame() : slopes(kRows, kCols), flux(kRows, kCols), valid(kRows, kCols, 1) {}
  SlopeField slopes;
  Image<float> flux;
  Image<std::uint8_t> valid;
};

/// Returns a frame with slope noise as photons make it: the variance is ∝ 1/flux, and x and y are
/// unequal and correlated.
Frame noise_frame(std::mt19937& random, const Image<float>& flux, double noise, double correlation,
                  double ratio) {
  std::normal_distribution<double> normal;
  Frame frame;
  frame.flux = flux;
  frame.slopes.valid.fill(1);
  frame.slopes.n_valid = kRows * kCols;
  for (std::size_t k = 0; k < flux.size(); ++k) {
    const double variance = noise / static_cast<double>(flux[k]);
    const double a = normal(random);
    const double b = correlation * a + std::sqrt(1.0 - correlation * correlation) * normal(random);
    frame.slopes.x[k] = static_cast<float>(a * std::sqrt(variance * ratio));
    frame.slopes.y[k] = static_cast<float>(b * std::sqrt(variance / ratio));
    frame.slopes.variance_x[k] = static_cast<float>(variance * ratio);
    frame.slopes.variance_y[k] = static_cast<float>(variance / ratio);
    frame.slopes.covariance_xy[k] = static_cast<float>(variance * correlation);
  }
  return frame;
}

Image<float> uneven_flux(std::mt19937& random) {
  std::lognormal_distribution<double> brightness(0.0, 1.0);
  Image<float> flux(kRows, kCols);
  for (float& f : flux) f = static_cast<float>(0.02 + brightness(random));
  return flux;
}

TEST(WhitenedFilter, SolvesTheCovarianceOfItsSlopes) {
  constexpr unsigned kSeed = 11;
  SCOPED_TRACE(kSeed);
  std::mt19937 random(kSeed);
  Frame frame = noise_frame(random, uneven_flux(random), 0.05, 0.0, 1.0);
  frame.slopes.valid(4, 5) = 0;  // This lenslet is missing.
  WhitenedPlanes planes(kRows, kCols);
  fill_planes(frame.slopes, frame.flux, frame.valid, kClutter, planes);
  const VortexPattern m;
  Eigen::Matrix<double, 9, 1> pattern;
  pattern << m.corner, m.side, m.corner, m.side, m.centre, m.side, m.corner, m.side, m.corner;
  for (const auto& [row, col] : {std::pair{3, 4}, {0, 0}, {7, 9}, {4, 4}, {5, 2}}) {
    // This is D of the nine cells as a stencil of the 16 lenslets' main and anti parts.
    Eigen::Matrix<double, 9, 32> stencil = Eigen::Matrix<double, 9, 32>::Zero();
    Eigen::Matrix<double, 32, 1> variance;
    for (int i = 0; i < 4; ++i)
      for (int j = 0; j < 4; ++j)
        variance[4 * i + j] = variance[16 + 4 * i + j] =
            static_cast<double>(planes.half_variance(row + i, col + j));
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) {
        stencil(3 * i + j, 4 * i + j) = 1.0;
        stencil(3 * i + j, 4 * (i + 1) + j + 1) = -1.0;
        stencil(3 * i + j, 16 + 4 * i + j + 1) = 1.0;
        stencil(3 * i + j, 16 + 4 * (i + 1) + j) = -1.0;
      }
    }
    const Eigen::Matrix<double, 9, 9> sigma = stencil * variance.asDiagonal() * stencil.transpose();
    const Eigen::Matrix<double, 9, 1> expected = sigma.ldlt().solve(pattern);
    const NodeFilter filter = filter_at(planes, m, row, col);
    for (int k = 0; k < 9; ++k)
      EXPECT_NEAR(static_cast<double>(filter.weights[static_cast<std::size_t>(k)]), expected[k],
                  2e-3 * expected.cwiseAbs().maxCoeff())
          << "node " << row << ", " << col << ", cell " << k;
    EXPECT_NEAR(static_cast<double>(filter.information), pattern.dot(expected),
                2e-3 * pattern.dot(expected));
  }
}

/// Takes t of every third node, so that they share few slopes, and tests its first two moments over
/// many frames.
void expect_standard_normal(double correlation, double ratio, bool uneven, bool missing) {
  constexpr unsigned kSeed = 12;
  SCOPED_TRACE(kSeed);
  std::mt19937 random(kSeed);
  const Image<float> flux = uneven ? uneven_flux(random) : Image<float>(kRows, kCols, 1.0F);
  WhitenedPlanes planes(kRows, kCols);
  double sum = 0.0, squares = 0.0;
  int n = 0;
  for (int trial = 0; trial < 3000; ++trial) {
    Frame frame = noise_frame(random, flux, 0.05, correlation, ratio);
    if (missing) {
      frame.slopes.valid(4, 4) = 0;
      frame.slopes.x(4, 4) = frame.slopes.y(4, 4) = 0.0F;
    }
    fill_planes(frame.slopes, frame.flux, frame.valid, kClutter, planes);
    for (int r = 0; r < kRows - 1; r += 3) {
      for (int c = 0; c < kCols - 1; c += 3) {
        const NodeFilter filter = filter_at(planes, {}, r, c);
        const double t = static_cast<double>(filter.sum) /
                         std::sqrt(static_cast<double>(noise_variance(frame.slopes, filter, r, c)));
        sum += t;
        squares += t * t;
        ++n;
      }
    }
  }
  // The tolerance is five standard deviations of independent values. It is not four, because
  // neighbours three apart share a row of lenslets.
  EXPECT_NEAR(sum / n, 0.0, 5.0 / std::sqrt(n));
  EXPECT_NEAR(squares / n, 1.0, 5.0 * std::sqrt(2.0 / n));
}

TEST(WhitenedFilter, StatisticIsStandardNormalInWhiteNoise) {
  expect_standard_normal(0.0, 1.0, false, false);
}

TEST(WhitenedFilter, StatisticIsStandardNormalInNoiseThatFollowsTheFlux) {
  expect_standard_normal(0.4, 1.7, true, false);
}

TEST(WhitenedFilter, StatisticIsStandardNormalRoundAMissingLenslet) {
  expect_standard_normal(0.4, 1.7, true, true);
}

TEST(WhitenedFilter, CirculationIsThatOfTheSlopes) {
  std::mt19937 random(13);
  const Frame frame = noise_frame(random, uneven_flux(random), 0.05, 0.2, 1.2);
  WhitenedPlanes planes(kRows, kCols);
  fill_planes(frame.slopes, frame.flux, frame.valid, kClutter, planes);
  CirculationMap map(kRows, kCols);
  circulate(frame.slopes, map);
  for (int r = 0; r < kRows - 1; ++r)
    for (int c = 0; c < kCols - 1; ++c)
      EXPECT_NEAR(planes.circulation(r + 1, c + 1), map.value(r, c), 1e-5F);
}

TEST(WhitenedFilter, FirstLookTellsTheFilterItself) {
  std::mt19937 random(14);
  const Frame frame = noise_frame(random, Image<float>(kRows, kCols, 1.0F), 0.3, 0.0, 1.0);
  WhitenedPlanes planes(kRows, kCols);
  fill_planes(frame.slopes, frame.flux, frame.valid, kClutter, planes);
  FirstLook look;
  look.offset = 0.3F;
  look_over(look, planes);
  int passed = 0;
  for (int r = 0; r < kRows - 1; ++r) {
    for (int c = 0; c < kCols - 1; ++c) {
      const NodeFilter filter = filter_at(planes, {}, r, c);
      const float z2 = filter.sum * filter.sum / filter.information;
      // All lenslets are of mean flux here, so that both tests know the noise.
      const float t2 = filter.sum * filter.sum / noise_variance(frame.slopes, filter, r, c);
      const float minimum = std::min(z2 / 0.09F, t2 / 0.5F);
      if (std::abs(minimum - 1.0F) > 0.02F) {
        EXPECT_EQ(planes.first_t_squared(r, c) >= 0.5F, minimum > 1.0F) << r << ", " << c;
      }
      passed += minimum > 1.0F ? 1 : 0;
    }
  }
  EXPECT_GT(passed, 5);
  EXPECT_LT(passed, 75);
}

TEST(WhitenedFilter, DarknessComparesFourLensletsWithTheEightBesideThem) {
  Frame frame;
  frame.slopes.valid.fill(1);
  frame.flux.fill(1.0F);
  for (const auto& [r, c] : {std::pair{3, 4}, {3, 5}, {4, 4}, {4, 5}}) frame.flux(r, c) = 0.05F;
  WhitenedPlanes planes(kRows, kCols);
  fill_planes(frame.slopes, frame.flux, frame.valid, kClutter, planes);
  look_over({}, planes);
  const double mean = (kRows * kCols - 4 * 0.95) / (kRows * kCols);
  EXPECT_NEAR(planes.darkness(3, 4), std::log((1.0 / mean + 0.02) / (0.05 / mean + 0.02)), 1e-3);
  EXPECT_NEAR(planes.darkness(0, 0), 0.0, 1e-3);
}

TEST(WhitenedFilter, QuickLogIsTheLogarithm) {
  for (double x = 1e-6; x < 1e6; x *= 1.37)
    EXPECT_NEAR(static_cast<double>(quick_log(static_cast<float>(x))), std::log(x), 2e-4) << x;
}

}  // namespace
}  // namespace curlew
