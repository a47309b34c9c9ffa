#include "detect/circulation.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstddef>
#include <random>
#include <string>
#include <vector>

#include "tests/detect/vortex_slopes.h"

namespace curlew {
namespace {

using testing::add_vortex;
using testing::flat_field;
using testing::remove_lenslet;

CirculationMap circulation_of(const SlopeField& slopes) {
  CirculationMap map(slopes.rows(), slopes.cols());
  circulate(slopes, map);
  return map;
}

SlopeField random_field(int rows, int cols, std::mt19937& random, double missing_share) {
  std::normal_distribution<float> noise(0.0F, 1.0F);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  SlopeField slopes = flat_field(rows, cols);
  for (std::size_t k = 0; k < slopes.x.size(); ++k) {
    slopes.x[k] = noise(random);
    slopes.y[k] = noise(random);
    slopes.variance_x[k] = 0.5F + noise(random) * noise(random);
    slopes.variance_y[k] = 0.5F + noise(random) * noise(random);
    slopes.covariance_xy[k] = 0.5F * std::tanh(noise(random));
  }
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < cols; ++c) {
      if (unit(random) < missing_share) remove_lenslet(slopes, r, c);
    }
  }
  return slopes;
}

/// Returns ∂D(cell)/∂s of every slope, [cells][x of all lenslets, then y], from unit impulses.
std::vector<std::vector<double>> responses(int rows, int cols) {
  const auto lenslets = static_cast<std::size_t>(rows * cols);
  const auto cells = static_cast<std::size_t>((rows - 1) * (cols - 1));
  std::vector<std::vector<double>> response(cells, std::vector<double>(2 * lenslets));
  for (std::size_t j = 0; j < 2 * lenslets; ++j) {
    SlopeField slopes = flat_field(rows, cols);
    (j < lenslets ? slopes.x[j] : slopes.y[j - lenslets]) = 1.0F;
    const CirculationMap map = circulation_of(slopes);
    for (std::size_t i = 0; i < cells; ++i) response[i][j] = static_cast<double>(map.value[i]);
  }
  return response;
}

TEST(Circulation, CanonicalVortexOnANode) {
  SlopeField slopes = flat_field(16, 16);
  add_vortex(slopes, 7.5, 6.5);
  // Eight slopes and seven sums are rounded to float at up to 4.5, which gives 5e-7.
  EXPECT_NEAR(static_cast<double>(circulation_of(slopes).value(6, 7)), 4.527887014709684, 1e-6);
}

TEST(Circulation, EqualsTheKernelInEveryCell) {
  SlopeField slopes = flat_field(12, 9);
  const Morphology elongated{0.8, 1.9};
  add_vortex(slopes, 4.2, 5.9, elongated);
  const CirculationMap map = circulation_of(slopes);
  const VortexKernel kernel(elongated);
  for (int r = 0; r < map.value.rows(); ++r) {
    for (int c = 0; c < map.value.cols(); ++c) {
      EXPECT_NEAR(static_cast<double>(map.value(r, c)),
                  kernel.circulation(4.2 - (c + 0.5), 5.9 - (r + 0.5)), 2e-6);
    }
  }
  EXPECT_EQ(map.n_valid, 11 * 8);
}

TEST(Circulation, LinearCoreOnANodeIsThree) {
  // This is ∫I∇φ/∫I with I = r² over a lenslet that has the vortex on its corner: ½ / (2/3) = ¾.
  SlopeField slopes = flat_field(2, 2);
  for (int r = 0; r < 2; ++r) {
    for (int c = 0; c < 2; ++c) {
      slopes.x(r, c) = r == 0 ? 0.75F : -0.75F;
      slopes.y(r, c) = c == 1 ? 0.75F : -0.75F;
    }
  }
  EXPECT_EQ(circulation_of(slopes).value(0, 0), 3.0F);
}

TEST(Circulation, Dipoles) {
  constexpr std::array<double, 7> kSeparation{0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0};
  constexpr std::array<double, 7> kD{0.787, 1.597, 2.496, 3.730, 4.354, 4.468, 4.516};
  for (std::size_t i = 0; i < kD.size(); ++i) {
    SlopeField slopes = flat_field(16, 16);
    add_vortex(slopes, 7.5, 7.5);
    add_vortex(slopes, 7.5 + kSeparation[i], 7.5, {3.14159265358979, 0.0});
    // The tolerance is half a unit of the last digit of the expected values.
    EXPECT_NEAR(static_cast<double>(circulation_of(slopes).value(7, 7)), kD[i], 5.1e-4);
  }
}

TEST(Circulation, OfAGradientIsZero) {
  constexpr unsigned kSeed = 11;
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  std::normal_distribution<double> noise(0.0, 1.0);
  Image<double> phase(21, 18);  // at the lenslets' corners
  for (double& p : phase) p = noise(random);
  SlopeField slopes = flat_field(20, 17);
  for (int r = 0; r < 20; ++r) {
    for (int c = 0; c < 17; ++c) {
      const double p00 = phase(r, c);
      const double p01 = phase(r, c + 1);
      const double p10 = phase(r + 1, c);
      const double p11 = phase(r + 1, c + 1);
      slopes.x(r, c) = static_cast<float>(0.5 * ((p01 - p00) + (p11 - p10)));
      slopes.y(r, c) = static_cast<float>(0.5 * ((p10 - p00) + (p11 - p01)));
    }
  }
  const CirculationMap map = circulation_of(slopes);
  // Each of eight slopes of up to 4 is rounded to 1.2e-7.
  for (const float d : map.value) EXPECT_NEAR(d, 0.0F, 2e-6F);
}

TEST(Circulation, RandomMasksAndVariancesAgainstTheFormula) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    std::mt19937 random(seed);
    const int rows = 2 + static_cast<int>(seed);
    const int cols = 40 - static_cast<int>(seed);
    const SlopeField s = random_field(rows, cols, random, 0.15);
    const CirculationMap map = circulation_of(s);
    int n_valid = 0;
    for (int r = 0; r + 1 < rows; ++r) {
      for (int c = 0; c + 1 < cols; ++c) {
        const bool whole = s.valid(r, c) != 0 && s.valid(r, c + 1) != 0 && s.valid(r + 1, c) != 0 &&
                           s.valid(r + 1, c + 1) != 0;
        n_valid += whole ? 1 : 0;
        ASSERT_EQ(map.valid(r, c), whole ? 1 : 0);
        if (!whole) {
          ASSERT_EQ(map.value(r, c), 0.0F);
          ASSERT_EQ(map.variance(r, c), 0.0F);
          continue;
        }
        const float d = 0.5F * (s.x(r, c) + s.x(r, c + 1) + s.y(r, c + 1) + s.y(r + 1, c + 1) -
                                s.x(r + 1, c + 1) - s.x(r + 1, c) - s.y(r + 1, c) - s.y(r, c));
        ASSERT_NEAR(map.value(r, c), d, 5e-6F);  // This allows another order of the float sums.
      }
    }
    EXPECT_EQ(map.n_valid, n_valid);
  }
}

TEST(Circulation, VarianceIsThatOfTheLinearForm) {
  constexpr unsigned kSeed = 5;
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  const SlopeField s = random_field(4, 5, random, 0.0);
  const CirculationMap map = circulation_of(s);
  const auto response = responses(4, 5);
  for (std::size_t i = 0; i < map.value.size(); ++i) {
    double variance = 0.0;
    for (std::size_t k = 0; k < 20; ++k) {
      const double a = response[i][k];
      const double b = response[i][20 + k];
      variance += a * a * static_cast<double>(s.variance_x[k]) +
                  b * b * static_cast<double>(s.variance_y[k]) +
                  2 * a * b * static_cast<double>(s.covariance_xy[k]);
    }
    // The tolerance is for float sums of a few units.
    EXPECT_NEAR(static_cast<double>(map.variance[i]), variance, 1e-5);
  }
}

TEST(Circulation, WhiteNoiseCorrelations) {
  // The responses give it exactly: the covariance is J·Jᵀ for unit slope noise.
  constexpr int kSize = 6;
  const auto j = responses(kSize, kSize);
  const auto covariance = [&](int r0, int c0, int r1, int c1) {
    const auto& a = j[static_cast<std::size_t>(r0 * (kSize - 1) + c0)];
    const auto& b = j[static_cast<std::size_t>(r1 * (kSize - 1) + c1)];
    double sum = 0.0;
    for (std::size_t k = 0; k < a.size(); ++k) sum += a[k] * b[k];
    return sum;
  };
  EXPECT_DOUBLE_EQ(covariance(2, 2, 2, 2), 2.0);  // σ_D is √2 σ.
  EXPECT_DOUBLE_EQ(covariance(2, 2, 2, 3), 0.0);
  EXPECT_DOUBLE_EQ(covariance(2, 2, 3, 2), 0.0);
  EXPECT_DOUBLE_EQ(covariance(2, 2, 3, 3), -0.5);  // This is −¼ of 2.
  EXPECT_DOUBLE_EQ(covariance(2, 2, 3, 1), -0.5);
  EXPECT_DOUBLE_EQ(covariance(2, 2, 2, 4), 0.0);
  const auto block_variance = [&](int n) {
    double sum = 0.0;
    for (int a = 0; a < n * n; ++a) {
      for (int b = 0; b < n * n; ++b) {
        sum += covariance(1 + a / n, 1 + a % n, 1 + b / n, 1 + b % n);
      }
    }
    return sum;
  };
  EXPECT_DOUBLE_EQ(block_variance(3), 10.0);  // The sum's σ is √10 σ.
  EXPECT_DOUBLE_EQ(block_variance(2), 6.0);   // The sum's σ is √6 σ.
}

TEST(Circulation, RowByRowEqualsWhole) {
  std::mt19937 random(3);
  const SlopeField slopes = random_field(17, 23, random, 0.1);
  const CirculationMap whole = circulation_of(slopes);
  CirculationMap parts(17, 23);
  int n_valid = 0;
  for (const auto& [first, last] : {std::array{0, 1}, {1, 1}, {1, 9}, {9, 16}}) {
    n_valid += circulate_rows(slopes, first, last, parts);
  }
  EXPECT_EQ(n_valid, whole.n_valid);
  for (std::size_t k = 0; k < whole.value.size(); ++k) {
    EXPECT_EQ(parts.value[k], whole.value[k]);
    EXPECT_EQ(parts.variance[k], whole.variance[k]);
    EXPECT_EQ(parts.valid[k], whole.valid[k]);
  }
}

TEST(Circulation, StaleCellsAreOverwritten) {
  CirculationMap map(5, 5);
  std::mt19937 random(4);
  circulate(random_field(5, 5, random, 0.0), map);
  SlopeField none(5, 5);
  circulate(none, map);
  EXPECT_EQ(map.n_valid, 0);
  for (std::size_t k = 0; k < map.value.size(); ++k) {
    EXPECT_EQ(map.value[k], 0.0F);
    EXPECT_EQ(map.valid[k], 0);
  }
}

}  // namespace
}  // namespace curlew
