// These tests prove what docs/paper.md says: where the paper (Chen, Roux & Olivier, J. Opt. Soc.
// Am. A 24, 1994, 2007) errs, and what a sensor that weights by intensity sees instead.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <complex>
#include <functional>
#include <numbers>
#include <span>

#include "detect/linear_core.h"
#include "detect/vortex_kernel.h"
#include "tests/support/analytic_slopes.h"
#include "tests/support/constants.h"

namespace curlew {
namespace {

using Slope = std::array<double, 2>;

/// Holds the slopes of the four lenslets of a cell, [row][col].
struct Cell {
  Slope s[2][2];
};

Cell cell_of(const std::function<Slope(double x, double y)>& slope_at, double x, double y) {
  Cell cell{};
  for (const int row : {0, 1})
    for (const int col : {0, 1}) cell.s[row][col] = slope_at(x + col - 0.5, y + row - 0.5);
  return cell;
}

/// Returns the circulation by Eq. 11 with its misprint mended (docs/paper.md, error 1).
double mended(const Cell& c) {
  return 0.5 * (c.s[0][0][0] + c.s[0][1][0] + c.s[0][1][1] + c.s[1][1][1] - c.s[1][1][0] -
                c.s[1][0][0] - c.s[1][0][1] - c.s[0][0][1]);
}

/// Returns the circulation as the paper prints Eq. 11: with G_x of lenslet (m, n) twice, and never
/// that of (m, n+1).
double printed(const Cell& c) {
  return 0.5 * (2.0 * c.s[0][0][0] + c.s[0][1][1] + c.s[1][1][1] - c.s[1][1][0] - c.s[1][0][0] -
                c.s[1][0][1] - c.s[0][0][1]);
}

Cell vortex_cell(Morphology m, double mu, double nu) {
  const VortexKernel kernel(m);
  return cell_of([&](double x, double y) { return kernel.lenslet_slopes(x, y); }, -mu, -nu);
}

constexpr Morphology kFigure7{kPi / 4, kPi};
constexpr Morphology kFigure8{4 * kPi / 9, kPi / 2};

// The tests below are about Eq. 11.

TEST(PaperErrors, PrintedCirculationSeesAVortexInADefocus) {
  // φ = κ(x² + y²)/2 has no vortex, and a lenslet's mean slope is κ times its centre.
  constexpr double kCurvature = 0.8;
  for (const double x : {-3.0, 0.25, 7.0}) {
    const Cell cell = cell_of(
        [](double sx, double sy) {
          return Slope{kCurvature * sx, kCurvature * sy};
        },
        x, 1);
    EXPECT_NEAR(mended(cell), 0.0, 1e-14);
    EXPECT_NEAR(printed(cell), -0.5 * kCurvature, 1e-14);
  }
}

TEST(PaperErrors, PrintedCirculationOfARoundVortexDependsOnTheAxes) {
  // A round vortex looks the same after a quarter turn, and its circulation must stay the same,
  // too.
  const Cell right = vortex_cell({}, 0.25, 0.0);
  const Cell below = vortex_cell({}, 0.0, 0.25);
  EXPECT_NEAR(mended(right), 3.740860224, 1e-9);
  EXPECT_NEAR(mended(below), mended(right), 1e-14);
  EXPECT_NEAR(printed(right), 3.231040, 1e-6);
  EXPECT_NEAR(printed(below), 3.740860224, 1e-9);
  // The circulation must also stay the same when the vortex goes to the opposite side.
  const Cell left = vortex_cell({}, -0.25, 0.0);
  EXPECT_NEAR(mended(left), mended(right), 1e-14);
  EXPECT_NEAR(printed(left), 4.250680, 1e-6);
  // The two agree where lenslets (m, n) and (m, n+1) mirror each other, which is on the line μ = 0.
  const Cell centre = vortex_cell({}, 0.0, 0.0);
  EXPECT_NEAR(printed(centre), mended(centre), 1e-14);
  // For a slanting core (B ≠ 0) they do not agree even on the node.
  const Cell slanting = vortex_cell(kFigure8, 0.0, 0.0);
  EXPECT_NEAR(mended(slanting), 5.524402127, 1e-9);
  EXPECT_NEAR(printed(slanting), 6.784475, 1e-6);
}

// The tests below are about the paper's statement that the circulation without averaging is 2π.

double point_sample_circulation(Morphology m) {
  const VortexKernel kernel(m);
  return mended(cell_of([&](double x, double y) { return kernel.gradient(x, y); }, 0.0, 0.0));
}

TEST(PaperErrors, PointSamplesGiveFour) {
  EXPECT_DOUBLE_EQ(point_sample_circulation({}), 4.0);
  // At (±½, ±½) |∇φ| = 1/r = √2, and each component is 1. The circulation is half of eight of them.
  // For any core it is 4C/(1 − B²).
  for (const Morphology m : {kFigure7, kFigure8, Morphology{0.7, 1.0}}) {
    const double b = std::sin(m.alpha_rad) * std::sin(m.beta_rad);
    EXPECT_NEAR(point_sample_circulation(m), 4 * std::cos(m.alpha_rad) / (1 - b * b), 1e-12);
  }
}

TEST(PaperErrors, TwoPiIsTheLineIntegralNotItsFourPointRule) {
  // This is the trapezoidal rule round the cell's contour with n intervals a side. With one
  // interval it is Eq. 11 of point samples. Its error falls as 1/n².
  const VortexKernel kernel;
  const auto contour = [&](int n) {
    double side = 0.0;  // The four sides are alike; this is the lowest.
    for (int i = 0; i <= n; ++i) {
      const double weight = i == 0 || i == n ? 0.5 : 1.0;
      side += weight * kernel.gradient(-0.5 + static_cast<double>(i) / n, -0.5)[0] / n;
    }
    return 4.0 * side;
  };
  EXPECT_DOUBLE_EQ(contour(1), 4.0);
  EXPECT_NEAR(contour(2), 6.0, 1e-12);
  EXPECT_NEAR(contour(1000), 2 * kPi, 1e-5);
  const double ratio = (2 * kPi - contour(50)) / (2 * kPi - contour(100));
  EXPECT_NEAR(ratio, 4.0, 0.01);
}

// The tests below are about the paper's appendix, Eq. A1.

/// Returns a textbook antiderivative of the kind of the appendix: logarithms of Q itself and
/// arctangents of quotients. `log` and `arctan` (of numerator and denominator) are left open.
template <typename Log, typename Arctan>
std::array<std::complex<double>, 2> textbook_corner(Morphology m, double x, double y,
                                                    const Log& log, const Arctan& arctan) {
  const double a = std::sin(m.alpha_rad) * std::cos(m.beta_rad);
  const double b = std::sin(m.alpha_rad) * std::sin(m.beta_rad);
  const double c = std::cos(m.alpha_rad);
  const double plus = 1 + a;
  const double minus = 1 - a;
  const double q = plus * x * x - 2 * b * x * y + minus * y * y;
  const std::complex<double> ln = log(q);
  const double along_x = arctan(plus * x - b * y, c * y);
  const double along_y = arctan(minus * y - b * x, c * x);
  return {-y * along_x - c / (2 * minus) * x * ln - b / minus * x * along_y,
          x * along_y + c / (2 * plus) * y * ln + b / plus * y * along_x};
}

template <typename Log, typename Arctan>
std::complex<double> textbook_circulation(Morphology m, double mu, double nu, const Log& log,
                                          const Arctan& arctan) {
  const auto mean = [&](double x0, double y0) {
    const auto p11 = textbook_corner(m, x0 + 1, y0 + 1, log, arctan);
    const auto p01 = textbook_corner(m, x0, y0 + 1, log, arctan);
    const auto p10 = textbook_corner(m, x0 + 1, y0, log, arctan);
    const auto p00 = textbook_corner(m, x0, y0, log, arctan);
    return std::array{p11[0] - p01[0] - p10[0] + p00[0], p11[1] - p01[1] - p10[1] + p00[1]};
  };
  const auto s00 = mean(-1 - mu, -1 - nu);
  const auto s01 = mean(-mu, -1 - nu);
  const auto s10 = mean(-1 - mu, -nu);
  const auto s11 = mean(-mu, -nu);
  return 0.5 * (s00[0] + s01[0] + s01[1] + s11[1] - s11[0] - s10[0] - s10[1] - s00[1]);
}

std::complex<double> ln_of(double q) { return std::log(q); }
std::complex<double> ln_of_minus(double q) { return std::log(std::complex<double>(-q, 0.0)); }
double arctan(double numerator, double denominator) { return std::atan(numerator / denominator); }
double full_turn_arctan(double numerator, double denominator) {
  return std::atan2(numerator, denominator);
}

TEST(PaperErrors, LogarithmsOfNegativeArgumentsCancel) {
  for (const Morphology m : {Morphology{0.7, 1.0}, kFigure7, kFigure8}) {
    const double d = VortexKernel(m).circulation(0.3, 0.2);
    EXPECT_NEAR(textbook_circulation(m, 0.3, 0.2, ln_of, arctan).real(), d, 1e-12);
    // ln(−Q) = ln Q + iπ. Real arithmetic has no value for it, and in D the iπ cancel.
    EXPECT_TRUE(std::isnan(std::log(-1.0)));
    const auto minus = textbook_circulation(m, 0.3, 0.2, ln_of_minus, arctan);
    EXPECT_NEAR(minus.real(), d, 1e-12);
    EXPECT_NEAR(minus.imag(), 0.0, 1e-12);
    EXPECT_NEAR(textbook_corner(m, 0.7, 0.8, ln_of_minus, arctan)[0].imag(),
                -0.7 * kPi * std::cos(m.alpha_rad) /
                    (2 * (1 - std::sin(m.alpha_rad) * std::cos(m.beta_rad))),
                1e-12);  // A corner alone keeps its share.
  }
}

TEST(PaperErrors, FullTurnArctangentIsWrong) {
  // Between the corners of one lenslet, atan2 jumps by 2π where its second argument is negative and
  // the first changes sign. arctan does not jump.
  const Morphology m{0.7, 1.0};
  const double d = VortexKernel(m).circulation(0.3, 0.2);
  EXPECT_NEAR(d, 3.079614607803, 1e-11);
  const double wrong = textbook_circulation(m, 0.3, 0.2, ln_of, full_turn_arctan).real();
  EXPECT_GT(std::abs(wrong - d), 0.1) << wrong;
}

TEST(PaperErrors, TextbookFormIsZeroByZeroWhereTheClosedFormIsNot) {
  const Morphology m{0.7, 1.0};
  for (const auto& [mu, nu] : {std::pair{1.0, 1.0}, {1.0, 0.0}, {0.0, 1.0}, {-1.0, 1.0}}) {
    EXPECT_TRUE(std::isnan(textbook_circulation(m, mu, nu, ln_of, arctan).real()));
    const double d = VortexKernel(m).circulation(mu, nu);
    EXPECT_NEAR(d, VortexKernel(m).circulation(mu + 1e-9, nu - 1e-9), 1e-7);
    EXPECT_NEAR(d, textbook_circulation(m, mu + 1e-7, nu - 1e-7, ln_of, arctan).real(), 1e-5);
  }
  // A₋ = 0 and C = 0 hold at α = 90°, β = 0, where the phase is a step of π across the slow axis.
  const Morphology line{std::acos(0.0), 0.0};
  const double lost = textbook_circulation(line, 0.3, 0.2, ln_of, arctan).real();
  EXPECT_FALSE(std::abs(lost - kPi * 0.8) < 0.1) << lost;
  EXPECT_NEAR(VortexKernel(line).circulation(0.3, 0.2), kPi * 0.8, 1e-9);
}

// The tests below are about Figs. 6 to 8.

/// Returns the circulation by quadrature of ∇φ, which uses no closed form.
double quadrature_circulation(Morphology m, double mu, double nu) {
  const TestVortex vortex{
      .x = 0.5 + mu, .y = 0.5 + nu, .alpha_rad = m.alpha_rad, .beta_rad = m.beta_rad};
  Cell cell{};
  for (const int row : {0, 1})
    for (const int col : {0, 1}) cell.s[row][col] = mean_phase_gradient(vortex, row, col);
  return mended(cell);
}

TEST(PaperErrors, PeaksOfFigures7And8) {
  // The paper says about 4.5 and about 5.
  EXPECT_NEAR(quadrature_circulation(kFigure7, 0, 0), 4.319620, 1e-6);
  EXPECT_NEAR(quadrature_circulation(kFigure8, 0, 0), 5.524402, 1e-6);
}

TEST(PaperErrors, SlowAxisOfFigure8) {
  // On ν = +μ the factor |u| grows slowest, and there D reaches farthest.
  const VortexKernel kernel(kFigure8);
  const auto u2 = [](double x, double y) {  // It is |ξz + ζz̄|².
    const auto xi = std::polar(std::cos(2 * kPi / 9), kPi / 4);
    const auto zeta = std::polar(std::sin(2 * kPi / 9), -kPi / 4);
    const std::complex<double> z(x, y);
    return std::norm(xi * z + zeta * std::conj(z));
  };
  EXPECT_LT(u2(1, 1), 0.01 * u2(1, -1));
  for (const double angle : {0.0, 30.0, 44.0, 46.0, 90.0, 135.0}) {
    const double rad = angle * kPi / 180;
    EXPECT_GT(u2(std::sqrt(2) * std::cos(rad), std::sqrt(2) * std::sin(rad)), u2(1, 1)) << angle;
  }
  for (const double t : {0.25, 0.5, 0.75}) {
    EXPECT_NEAR(quadrature_circulation(kFigure8, t, t), kernel.circulation(t, t), 1e-10);
    EXPECT_GT(kernel.circulation(t, t), 1.2 * kernel.circulation(t, -t));
  }
}

TEST(PaperErrors, IntensityWeightingReversesFigure6) {
  // Averaged uniformly, the peak rises with α where β = 90° and falls where β = 0. Weighted by
  // intensity it goes to 0 for every β; at β = 90° it first rises to 48/(2√63) = 3.024 at cos² α =
  // 7/9.
  for (const double beta : {0.0, kPi / 4, kPi / 2, kPi}) {
    for (const double alpha : {0.0, kPi / 12, kPi / 4, kPi / 3, 4 * kPi / 9}) {
      const LinearCore core({alpha, beta});
      EXPECT_NEAR(core.peak_circulation(), core.circulation(0, 0), 1e-12);
      EXPECT_LE(core.peak_circulation(), 24 / std::sqrt(63.0) + 1e-12);
    }
    EXPECT_LT(LinearCore({kPi / 2 - 1e-3, beta}).peak_circulation(), 0.01);
    EXPECT_GT(VortexKernel({kPi / 2 - 1e-3, beta}).peak_circulation(), kPi);
  }
  EXPECT_NEAR(LinearCore({std::acos(std::sqrt(7.0 / 9)), kPi / 2}).peak_circulation(),
              24 / std::sqrt(63.0), 1e-12);
  EXPECT_NEAR(LinearCore().peak_circulation(), 3.0, 1e-14);
  EXPECT_NEAR(LinearCore(kFigure7).peak_circulation(), 2.12, 0.005);
  EXPECT_NEAR(LinearCore(kFigure8).peak_circulation(), 1.15, 0.005);
  // Averaged uniformly, Fig. 8's peak is above the round core's. Weighted by intensity it is the
  // least of all.
  EXPECT_GT(VortexKernel(kFigure8).peak_circulation(), VortexKernel().peak_circulation());
}

TEST(PaperErrors, LinearCoreEqualsQuadrature) {
  for (const Morphology m : {Morphology{}, kFigure7, kFigure8, Morphology{1.2, 2.5}}) {
    const TestVortex vortex{.x = 0.3, .y = -0.4, .alpha_rad = m.alpha_rad, .beta_rad = m.beta_rad};
    const LinearCore core(m);
    for (const int row : {-1, 0, 2}) {
      for (const int col : {-2, 0, 1}) {
        const auto exact = weighted_phase_gradient(std::span(&vortex, 1), row, col);
        const auto closed = core.lenslet_slopes(col - vortex.x, row - vortex.y);
        EXPECT_NEAR(closed[0], exact[0], 1e-12);
        EXPECT_NEAR(closed[1], exact[1], 1e-12);
      }
    }
  }
  double sum = 0.0;
  for (const double y : {-1.0, 0.0, 1.0})
    for (const double x : {-1.0, 0.0, 1.0}) sum += LinearCore().circulation(x, y);
  EXPECT_NEAR(sum, 5.7857, 5e-5);
}

}  // namespace
}  // namespace curlew
