#include "acquisition/simulator/phase_screen.h"

#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <numbers>
#include <vector>

#include "tests/support/constants.h"

namespace curlew {
namespace {

constexpr std::uint64_t kScreenSeed = 5;

using Screens = Image<std::complex<float>>;

Screens draw(PhaseScreens& screens, int n, std::int64_t realisation, int pair = 0,
             const ScreenShift& first = {}, const ScreenShift& second = {}) {
  SquareFft fft(n);
  Screens drawn(n, n);
  screens.draw(realisation, pair, first, second, fft, drawn);
  return drawn;
}

double part(const Screens& screens, int i, int j, bool second) {
  return static_cast<double>(second ? screens(i, j).imag() : screens(i, j).real());
}

// Returns D(r) = 2[B(0) − B(r)] with von Kármán's covariance
//   B(r) = (L0/r0)^(5/3) c Γ(11/6)/(2^(5/6) π^(8/3)) (2πr/L0)^(5/6) K_(5/6)(2πr/L0),
//   c = (24/5 Γ(6/5))^(5/6).
double von_karman_structure(double r, double r0, double outer_scale) {
  const double scale = std::pow(outer_scale / r0, 5.0 / 3.0) * std::tgamma(11.0 / 6.0) *
                       std::pow(24.0 / 5.0 * std::tgamma(6.0 / 5.0), 5.0 / 6.0) /
                       std::pow(kPi, 8.0 / 3.0);
  const double x = 2.0 * kPi * r / outer_scale;
  const double at_r =
      scale * std::pow(2.0, -5.0 / 6.0) * std::pow(x, 5.0 / 6.0) * std::cyl_bessel_k(5.0 / 6.0, x);
  return 2.0 * (0.5 * scale * std::tgamma(5.0 / 6.0) - at_r);
}

TEST(PhaseScreens, TheoryIsFriedsWhereTheOuterScaleIsFar) {
  const double r = 0.01;
  EXPECT_NEAR(von_karman_structure(r, 1.0, 1e6) / std::pow(r, 5.0 / 3.0), 6.88, 0.02);
}

// This compares what a screen's frequencies add up to with theory. Below 4 points the spectrum's
// end counts.
TEST(PhaseScreens, FrequenciesAddUpToTheStructureFunction) {
  const int n = 256;
  const double spacing = 0.008;
  PhaseScreens inside(n, spacing, {0.7, 1.0, 0.0}, false, kScreenSeed);
  for (const int points : {4, 8, 16, 32, 64, 128}) {
    const double r = points * spacing;
    EXPECT_NEAR(inside.expected_structure(r, 0.0) / von_karman_structure(r, 0.7, 1.0), 1.0, 0.015);
  }
  // Outer scales far beyond the grid test the subharmonics. Beyond an eighth of the width their
  // coarse steps show: they make 2.5 % at a quarter.
  for (const double outer_scale : {10.0, 400.0}) {
    PhaseScreens beyond(n, spacing, {0.7, outer_scale, 0.0}, true, kScreenSeed);
    for (const int points : {4, 8, 16, 32}) {
      const double r = points * spacing;
      const double theory = von_karman_structure(r, 0.7, outer_scale);
      EXPECT_NEAR(beyond.expected_structure(r, 0.0) / theory, 1.0, 0.015) << r;
      EXPECT_NEAR(beyond.expected_structure(r * 0.6, r * 0.8) / theory, 1.0, 0.015) << r;
    }
  }
}

// Compares the screens themselves with the same theory, by the mean over realisations and its
// scatter.
void expect_structure(int n, double outer_scale, bool subharmonics, int lag, int realisations) {
  SCOPED_TRACE(::testing::Message()
               << "seed " << kScreenSeed << ", outer scale " << outer_scale << ", lag " << lag);
  const double spacing = 0.008;
  PhaseScreens screens(n, spacing, {0.7, outer_scale, 0.0}, subharmonics, kScreenSeed);
  const double theory = von_karman_structure(lag * spacing, 0.7, outer_scale);
  double sum = 0.0;
  double squares = 0.0;
  for (int k = 0; k < realisations; ++k) {
    const Screens drawn = draw(screens, n, k);
    for (const bool second : {false, true}) {
      double structure = 0.0;
      for (int i = 0; i < n - lag; ++i) {
        for (int j = 0; j < n - lag; ++j) {
          const double here = part(drawn, i, j, second);
          structure += 0.5 * (std::pow(part(drawn, i, j + lag, second) - here, 2) +
                              std::pow(part(drawn, i + lag, j, second) - here, 2));
        }
      }
      structure /= static_cast<double>(n - lag) * (n - lag) * theory;
      sum += structure;
      squares += structure * structure;
    }
  }
  const double count = 2.0 * realisations;
  const double mean = sum / count;
  const double error = std::sqrt((squares / count - mean * mean) / (count - 1.0));
  EXPECT_LT(error, 0.06);
  EXPECT_NEAR(mean, 1.0, 4.0 * error + 0.025);  // The .025 is what frequencies lack.
}

TEST(PhaseScreens, StructureFunctionIsVonKarmans) {
  expect_structure(128, 0.5, false, 8, 40);
  expect_structure(128, 0.5, false, 32, 40);
  expect_structure(128, 400.0, true, 8, 80);
  expect_structure(128, 400.0, true, 32, 160);  // This is mostly tilt, which is slow to average.
}

TEST(PhaseScreens, BothScreensHaveTheirVariance) {
  const int n = 128;
  PhaseScreens screens(n, 0.01, {0.5, 0.3, 0.0}, false, kScreenSeed);
  double variance[2] = {0.0, 0.0};
  double product = 0.0;
  constexpr int kRealisations = 60;
  for (int k = 0; k < kRealisations; ++k) {
    const Screens drawn = draw(screens, n, k);
    for (const auto& value : drawn) {
      variance[0] += std::pow(static_cast<double>(value.real()), 2);
      variance[1] += std::pow(static_cast<double>(value.imag()), 2);
      product += static_cast<double>(value.real()) * static_cast<double>(value.imag());
    }
  }
  const double points = static_cast<double>(n) * n * kRealisations;
  const double expected = screens.expected_variance();
  // A screen has an area of some 18 outer scales squared, 1000 in all, so a standard error is 4.5
  // %.
  EXPECT_NEAR(variance[0] / points / expected, 1.0, 0.15) << "seed " << kScreenSeed;
  EXPECT_NEAR(variance[1] / points / expected, 1.0, 0.15) << "seed " << kScreenSeed;
  EXPECT_NEAR(product / points / expected, 0.0, 0.15) << "seed " << kScreenSeed;
}

TEST(PhaseScreens, DependOnSeedRealisationAndPairAlone) {
  const int n = 32;
  const VonKarman spectrum{0.2, 10.0, 0.0};
  PhaseScreens screens(n, 0.01, spectrum, true, kScreenSeed);
  PhaseScreens again(n, 0.01, spectrum, true, kScreenSeed);
  PhaseScreens other(n, 0.01, spectrum, true, kScreenSeed + 1);
  draw(screens, n, 0);
  const Screens a = draw(screens, n, 7, 2);
  const Screens b = draw(again, n, 7, 2);
  EXPECT_TRUE(std::equal(a.begin(), a.end(), b.begin()));
  for (const Screens& c : {draw(other, n, 7, 2), draw(screens, n, 8, 2), draw(screens, n, 7, 3)}) {
    EXPECT_FALSE(std::equal(a.begin(), a.end(), c.begin()));
  }
}

// More points over the same width are the same screen in more detail.
TEST(PhaseScreens, FinerGridDrawsTheSameScreen) {
  const VonKarman spectrum{0.2, 10.0, 0.15};  // Both grids resolve the inner scale.
  PhaseScreens coarse(64, 0.02, spectrum, true, kScreenSeed);
  PhaseScreens fine(128, 0.01, spectrum, true, kScreenSeed);
  const Screens a = draw(coarse, 64, 3);
  const Screens b = draw(fine, 128, 3);
  for (int i = 0; i < 64; ++i) {
    for (int j = 0; j < 64; ++j) EXPECT_LT(std::abs(a(i, j) - b(2 * i, 2 * j)), 2e-3);
  }
}

// The flow is frozen. Both screens move by whole points along x and y, the second by others than
// the first.
TEST(PhaseScreens, WindMovesEachScreenByItsOwnShift) {
  const int n = 64;
  const double spacing = 0.02;
  PhaseScreens screens(n, spacing, {0.2, 10.0, 0.0}, false, kScreenSeed);
  const Screens still = draw(screens, n, 4);
  const Screens moved =
      draw(screens, n, 4, 0, {3 * spacing, -5 * spacing}, {-7 * spacing, 64 * spacing});
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) {
      // The tolerance is for float rounding of screens of some 10 rad.
      EXPECT_NEAR(moved((i + n - 5) % n, (j + 3) % n).real(), still(i, j).real(), 1e-4);
      EXPECT_NEAR(moved(i, (j + n - 7) % n).imag(), still(i, j).imag(), 1e-4);
    }
  }
}

// Subharmonics move too, without coming round.
TEST(PhaseScreens, WindMovesSubharmonics) {
  const int n = 64;
  const double spacing = 0.02;
  PhaseScreens screens(n, spacing, {0.2, 100.0, 0.0}, true, kScreenSeed);
  PhaseScreens periodic(n, spacing, {0.2, 100.0, 0.0}, false, kScreenSeed);
  const Screens still = draw(screens, n, 4);
  const Screens moved = draw(screens, n, 4, 0, {9 * spacing, 2 * spacing}, {0.0, 0.0});
  double slow = 0.0;
  for (int i = 0; i + 2 < n; ++i) {
    for (int j = 0; j + 9 < n; ++j) {
      EXPECT_NEAR(moved(i + 2, j + 9).real(), still(i, j).real(), 1e-3);
      EXPECT_NEAR(moved(i, j).imag(), still(i, j).imag(), 1e-3);
    }
  }
  const Screens without = draw(periodic, n, 4);
  for (int j = 0; j < n; ++j) {
    slow += static_cast<double>(std::norm(still(0, j) - without(0, j)));
  }
  EXPECT_GT(slow / n, 1.0);  // There must be something to move.
}

}  // namespace
}  // namespace curlew
