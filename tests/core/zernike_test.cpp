#include "core/zernike.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "core/error.h"
#include "tests/support/analytic_slopes.h"

namespace curlew {
namespace {

// The expected values are Noll's Table I, written out.
TEST(Zernike, FirstElevenAreNolls) {
  for (const double rho : {0.0, 0.3, 1.0}) {
    for (const double theta : {0.0, 0.7, 2.5, 4.0}) {
      const double x = rho * std::cos(theta);
      const double y = rho * std::sin(theta);
      const double r2 = rho * rho;
      const double r3 = r2 * rho;
      const double expected[] = {
          1.0,
          2.0 * x,
          2.0 * y,
          std::sqrt(3.0) * (2.0 * r2 - 1.0),
          std::sqrt(6.0) * r2 * std::sin(2.0 * theta),
          std::sqrt(6.0) * r2 * std::cos(2.0 * theta),
          std::sqrt(8.0) * (3.0 * r3 - 2.0 * rho) * std::sin(theta),
          std::sqrt(8.0) * (3.0 * r3 - 2.0 * rho) * std::cos(theta),
          std::sqrt(8.0) * r3 * std::sin(3.0 * theta),
          std::sqrt(8.0) * r3 * std::cos(3.0 * theta),
          std::sqrt(5.0) * (6.0 * r2 * r2 - 6.0 * r2 + 1.0),
      };
      for (int j = 1; j <= 11; ++j) {
        EXPECT_NEAR(Zernike(j)(x, y), expected[j - 1], 1e-14) << "Z" << j;  // This is rounding.
      }
    }
  }
}

// 10 Gauss points in ρ and 64 angles integrate products up to radial order 7 exactly.
TEST(Zernike, OrthonormalOverTheDisc) {
  constexpr int kAngles = 64;
  for (int i = 1; i <= 36; ++i) {
    for (int j = i; j <= 36; ++j) {
      const Zernike a(i);
      const Zernike b(j);
      const auto ring = [&](double rho) {
        double sum = 0.0;
        for (int k = 0; k < kAngles; ++k) {
          const double theta = 2.0 * std::numbers::pi * k / kAngles;
          const double x = rho * std::cos(theta);
          const double y = rho * std::sin(theta);
          sum += a(x, y) * b(x, y);
        }
        return 2.0 * rho * sum / kAngles;
      };
      const auto mean = analytic_slopes::integrate_once<double>(ring, 0.0, 1.0);
      // 17-digit Gauss nodes and coefficients up to 420 leave some 1e-13.
      EXPECT_NEAR(mean, i == j ? 1.0 : 0.0, 1e-11) << i << ", " << j;
    }
  }
}

TEST(Zernike, HighOrdersStayNormalised) {
  const Zernike highest(Zernike::kLargestNoll);
  EXPECT_EQ(highest.radial_order(), 30);
  EXPECT_EQ(highest.azimuthal_order(), 30);
  // At the rim every radial polynomial is 1; alternating sums of 1e10 leave 1e-5 in double.
  const Zernike spherical(466);
  EXPECT_EQ(spherical.radial_order(), 30);
  EXPECT_EQ(spherical.azimuthal_order(), 0);
  EXPECT_NEAR(spherical(1.0, 0.0), std::sqrt(31.0), 1e-3);
}

TEST(Zernike, RefusesOtherIndices) {
  EXPECT_THROW(Zernike(0), UsageError);
  EXPECT_THROW(Zernike(Zernike::kLargestNoll + 1), UsageError);
}

}  // namespace
}  // namespace curlew
