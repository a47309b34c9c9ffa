// Zernike coefficients of wavefronts whose coefficients are known.
#include "reconstruct/modes/mode_fit.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "tests/support/mean_slopes.h"

namespace curlew {
namespace {

Image<std::uint8_t> ring(int n, double outer, double inner) {
  Image<std::uint8_t> valid(n, n);
  const double centre = 0.5 * (n - 1);
  for (int row = 0; row < n; ++row)
    for (int col = 0; col < n; ++col) {
      const double distance = std::hypot(row - centre, col - centre);
      valid(row, col) = distance <= outer && distance >= inner ? 1 : 0;
    }
  return valid;
}

Phase mode(int noll, const ZernikePupil& pupil) {
  return [z = Zernike(noll), pupil](double x, double y) {
    return z((x - pupil.x) / pupil.radius, (y - pupil.y) / pupil.radius);
  };
}

void expect_only(const Eigen::VectorXd& coefficients, int noll, double tolerance) {
  for (Eigen::Index i = 0; i < coefficients.size(); ++i)
    EXPECT_NEAR(coefficients[i], i + 2 == noll ? 1.0 : 0.0, tolerance) << "Noll " << i + 2;
}

// The tolerance is that of slopes kept in float.
constexpr double kFloat = 1e-5;

TEST(ModeFits, EveryModeOfADiscIsFoundAlone) {
  const Image<std::uint8_t> valid = ring(16, 8.0, 0.0);
  const ModePlan plan(valid, 36);
  ASSERT_EQ(plan.modes(), 35);
  EXPECT_EQ(plan.pupil().radius, 8.0);
  EXPECT_EQ(plan.pupil().obscuration, 0.0);
  ModeFit fit(plan);
  for (int noll = 2; noll <= 36; ++noll) {
    ASSERT_TRUE(fit.fit(slopes_of(mode(noll, plan.pupil()), valid)));
    expect_only(fit.coefficients(), noll, kFloat);
  }
}

TEST(ModeFits, FadedLensletsChangeNothing) {
  const Image<std::uint8_t> valid = ring(16, 8.0, 0.0);
  const ModePlan plan(valid, 36);
  ModeFit fit(plan);
  std::mt19937 random(7);
  for (const int noll : {2, 4, 11, 36}) {
    SlopeField slopes = slopes_of(mode(noll, plan.pupil()), valid);
    for (std::uint8_t& lenslet : slopes.valid)
      if (random() % 4 == 0) lenslet = 0;
    ASSERT_TRUE(fit.fit(slopes));
    expect_only(fit.coefficients(), noll, 10 * kFloat);
  }
  ASSERT_TRUE(fit.fit(slopes_of(mode(5, plan.pupil()), valid))) << "all lenslets are back";
  expect_only(fit.coefficients(), 5, kFloat);
}

// The annular polynomials are Mahajan's, J. Opt. Soc. Am. 71, 75, Table I.
TEST(ModeFits, AnAnnulusHasModesOfItsOwn) {
  const Image<std::uint8_t> valid = ring(20, 10.0, 3.0);
  const ModePlan plan(valid, 36);
  const ZernikePupil& pupil = plan.pupil();
  EXPECT_NEAR(pupil.obscuration, 0.3, 0.03);
  const double e2 = pupil.obscuration * pupil.obscuration;
  const auto squared = [&](double x, double y) {
    return (std::pow(x - pupil.x, 2) + std::pow(y - pupil.y, 2)) / std::pow(pupil.radius, 2);
  };
  ModeFit fit(plan);
  const Phase tilt = [&](double x, double) {
    return 2.0 * (x - pupil.x) / pupil.radius / std::sqrt(1.0 + e2);
  };
  ASSERT_TRUE(fit.fit(slopes_of(tilt, valid)));
  expect_only(fit.coefficients(), 2, kFloat);
  const Phase defocus = [&](double x, double y) {
    return std::sqrt(3.0) * (2.0 * squared(x, y) - 1.0 - e2) / (1.0 - e2);
  };
  ASSERT_TRUE(fit.fit(slopes_of(defocus, valid)));
  expect_only(fit.coefficients(), 4, kFloat);
  const Phase spherical = [&](double x, double y) {
    const double r2 = squared(x, y);
    return std::sqrt(5.0) * (6.0 * r2 * r2 - 6.0 * (1.0 + e2) * r2 + 1.0 + 4.0 * e2 + e2 * e2) /
           std::pow(1.0 - e2, 2);
  };
  ASSERT_TRUE(fit.fit(slopes_of(spherical, valid)));
  expect_only(fit.coefficients(), 11, kFloat);
}

TEST(ModeFits, ASquarePupilHasTheDiscThroughItsCorners) {
  const Image<std::uint8_t> valid(12, 16, 1);
  const ModePlan plan(valid, 36);
  EXPECT_NEAR(plan.pupil().radius, 10.0, 1e-12);
  ModeFit fit(plan);
  for (const int noll : {2, 3, 8, 36}) {
    ASSERT_TRUE(fit.fit(slopes_of(mode(noll, plan.pupil()), valid)));
    expect_only(fit.coefficients(), noll, 10 * kFloat);
  }
}

TEST(ModeFits, FewLensletsTellFewModesOrNone) {
  const ModePlan small(ring(5, 2.5, 0.0), 36);
  EXPECT_EQ(small.modes(), 9) << "21 lenslets are enough for three orders";
  ModeFit fit(small);
  SlopeField slopes = slopes_of(mode(4, small.pupil()), ring(5, 2.5, 0.0));
  slopes.valid.fill(0);
  EXPECT_FALSE(fit.fit(slopes));
  EXPECT_TRUE(fit.coefficients().array().isNaN().all());
  slopes.valid(2, 2) = slopes.valid(2, 3) = 1;
  EXPECT_FALSE(fit.fit(slopes));
  Image<std::uint8_t> one(3, 3);
  one(1, 1) = 1;
  const ModePlan none(one, 36);
  EXPECT_EQ(none.modes(), 0);
  EXPECT_FALSE(ModeFit(none).fit(SlopeField(3, 3)));
}

/// Adds noise with the slopes' own variances to a phase of every mode, again and again, and
/// compares the scatter of each coefficient with its stated error.
void expect_stated_errors(const Image<std::uint8_t>& valid, double faded) {
  constexpr int kFrames = 400;
  const ModePlan plan(valid, 36);
  ModeFit fit(plan);
  std::mt19937 random(19);
  std::uniform_real_distribution<double> any(0.0, 1.0);
  std::normal_distribution<double> normal;
  SlopeField truth(valid.rows(), valid.cols());  // of a plane wave: the fit is linear
  truth.valid = valid;
  for (std::size_t k = 0; k < truth.valid.size(); ++k) {
    if (any(random) < faded) truth.valid[k] = 0;
    const double x = 0.05 + 0.2 * any(random);
    const double y = 0.05 + 0.2 * any(random);
    truth.variance_x[k] = static_cast<float>(x * x);
    truth.variance_y[k] = static_cast<float>(y * y);
    truth.covariance_xy[k] = static_cast<float>(0.8 * x * y);
  }
  Eigen::ArrayXd square = Eigen::ArrayXd::Zero(plan.modes());
  for (int i = 0; i < kFrames; ++i) {
    SlopeField slopes = truth;
    for (std::size_t k = 0; k < slopes.x.size(); ++k) {
      const double x = normal(random);
      const double y = 0.8 * x + 0.6 * normal(random);  // they correlate by .8
      slopes.x[k] += std::sqrt(slopes.variance_x[k]) * static_cast<float>(x);
      slopes.y[k] += std::sqrt(slopes.variance_y[k]) * static_cast<float>(y);
    }
    ASSERT_TRUE(fit.fit(slopes));
    const Eigen::ArrayXd errors = fit.find_errors(slopes);
    square += (fit.coefficients().array() / errors).square() / kFrames;
  }
  // χ² of 400 has a standard deviation of .07; of 35 such the outermost lie at about .2.
  EXPECT_NEAR(square.mean(), 1.0, 0.05);
  EXPECT_GT(square.minCoeff(), 0.7);
  EXPECT_LT(square.maxCoeff(), 1.35);
}

TEST(ModeErrors, AreTheScatterOnADisc) { expect_stated_errors(ring(16, 8.0, 0.0), 0.0); }
TEST(ModeErrors, AreTheScatterOnAnAnnulus) { expect_stated_errors(ring(20, 10.0, 3.0), 0.0); }
TEST(ModeErrors, AreTheScatterWhereLensletsFaded) { expect_stated_errors(ring(16, 8.0, 0.0), 0.2); }
TEST(ModeErrors, AreTheScatterOnASquare) {
  expect_stated_errors(Image<std::uint8_t>(12, 16, 1), 0.1);
}

TEST(ModeErrors, AreUnknownWhereTheModesAre) {
  const Image<std::uint8_t> valid = ring(16, 8.0, 0.0);
  const ModePlan plan(valid, 36);
  ModeFit fit(plan);
  SlopeField slopes = slopes_of(mode(4, plan.pupil()), valid);
  slopes.valid.fill(0);
  EXPECT_FALSE(fit.fit(slopes));
  EXPECT_TRUE(fit.find_errors(slopes).array().isNaN().all());
}

}  // namespace
}  // namespace curlew
