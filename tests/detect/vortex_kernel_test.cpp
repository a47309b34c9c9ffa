#include "detect/vortex_kernel.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <cstddef>
#include <functional>
#include <numbers>
#include <random>
#include <string>

#include "tests/support/constants.h"

namespace curlew {
namespace {

constexpr double kLn2 = std::numbers::ln2;

// Each tolerance is half a unit of the last digit of the expected values.
constexpr double kHalf3 = 0.5001e-3;
constexpr double kHalf4 = 0.5001e-4;
constexpr double kHalf6 = 0.5001e-6;
constexpr double kHalf8 = 0.5001e-8;
constexpr double kHalf9 = 0.5001e-9;
constexpr double kHalf10 = 0.5001e-10;
constexpr double kHalf12 = 0.5001e-12;

using Integrand = std::function<double(double)>;

/// Integrates by adaptive Gauss–Kronrod (7, 15), which uses no closed form. A piece is cut until
/// its two rules agree. By then the finer one is right to far more digits than the tolerance says.
double integrate(const Integrand& f, double a, double b, double tolerance, int depth = 0) {
  constexpr std::array<double, 8> x{
      0.991455371120812639206854697526329, 0.949107912342758524526189684047851,
      0.864864423359769072789712788640926, 0.741531185599394439863864773280788,
      0.586087235467691130294144691693013, 0.405845151377397166906606412076961,
      0.207784955007898467600689403773245, 0.0};
  constexpr std::array<double, 8> kronrod{
      0.022935322010529224963732008058970, 0.063092092629978553290700663189204,
      0.104790010322250183839876322541518, 0.140653259715525918745189590510238,
      0.169004726639267902826583426598550, 0.190350578064785409913256402421014,
      0.204432940075298892414161999234649, 0.209482141084727828012999174891714};
  constexpr std::array<double, 4> gauss{
      0.129484966168869693270611432679082, 0.279705391489276667901467771423780,
      0.381830050505118944950369775488975, 0.417959183673469387755102040816327};
  const double middle = 0.5 * (a + b);
  const double half = 0.5 * (b - a);
  double fine = 0.0;
  double coarse = 0.0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    const double value =
        x[i] == 0.0 ? f(middle) : f(middle - half * x[i]) + f(middle + half * x[i]);
    fine += kronrod[i] * value;
    if (i % 2 == 1) coarse += gauss[i / 2] * value;
  }
  if (depth > 1 && (std::abs(fine - coarse) * half < tolerance || depth > 30)) return fine * half;
  return integrate(f, a, middle, tolerance, depth + 1) +
         integrate(f, middle, b, tolerance, depth + 1);
}

/// Returns ∇φ straight from φ = Im ln u with u = ξz + ζz̄: Im(∇u/u). It uses long double, because u
/// nearly vanishes along the slow axis of an elongated core.
std::array<double, 2> gradient_of(Morphology m, double x, double y) {
  using Complex = std::complex<long double>;
  const long double half_alpha = 0.5L * static_cast<long double>(m.alpha_rad);
  const long double half_beta = 0.5L * static_cast<long double>(m.beta_rad);
  const Complex xi = std::cos(half_alpha) * Complex(std::cos(half_beta), std::sin(half_beta));
  const Complex zeta = std::sin(half_alpha) * Complex(std::cos(half_beta), -std::sin(half_beta));
  const Complex z(static_cast<long double>(x), static_cast<long double>(y));
  const Complex u = xi * z + zeta * std::conj(z);
  return {static_cast<double>(((xi + zeta) / u).imag()),
          static_cast<double>((Complex(0, 1) * (xi - zeta) / u).imag())};
}

/// Returns the mean of ∇φ over a rectangle by quadrature along its sides. ∇φ falls as 1/r along
/// every ray, so that div(r ∇φ) = ∇φ component by component, and the integral is that of ∇φ (r·n)
/// round the rim. The singular point itself is never evaluated.
std::array<double, 2> quadrature_mean(Morphology m, double x0, double y0, double x1, double y1) {
  std::array<double, 2> mean{};
  const double area = (x1 - x0) * (y1 - y0);
  for (const std::size_t axis : {std::size_t{0}, std::size_t{1}}) {
    const auto side = [&](bool upright, double at, double from, double to) {
      if (at == 0.0) return 0.0;  // r·n = 0 there.
      const auto f = [&](double s) {
        return upright ? gradient_of(m, at, s)[axis] : gradient_of(m, s, at)[axis];
      };
      const double split = std::clamp(0.0, from, to);
      return at * (integrate(f, from, split, 1e-11) + integrate(f, split, to, 1e-11));
    };
    mean[axis] = (side(true, x1, y0, y1) - side(true, x0, y0, y1) + side(false, y1, x0, x1) -
                  side(false, y0, x0, x1)) /
                 area;
  }
  return mean;
}

double quadrature_circulation(Morphology m, double t, double u) {
  const auto s00 = quadrature_mean(m, -1.0 - t, -1.0 - u, -t, -u);
  const auto s01 = quadrature_mean(m, -t, -1.0 - u, 1.0 - t, -u);
  const auto s10 = quadrature_mean(m, -1.0 - t, -u, -t, 1.0 - u);
  const auto s11 = quadrature_mean(m, -t, -u, 1.0 - t, 1.0 - u);
  return 0.5 * (s00[0] + s01[0] + s01[1] + s11[1] - s11[0] - s10[0] - s10[1] - s00[1]);
}

double radians(double degrees) { return degrees * kPi / 180.0; }

TEST(VortexKernel, CornerAndNodeValues) {
  const VortexKernel kernel;
  // A handful of operations on values near 5 is rounded by this much.
  constexpr double kRounding = 4e-15;
  for (const double sx : {-1.0, 1.0}) {
    for (const double sy : {-1.0, 1.0}) {
      const auto s = kernel.lenslet_slopes(0.5 * sx, 0.5 * sy);
      EXPECT_NEAR(s[0], -sy * 1.131971753677421, kRounding);
      EXPECT_NEAR(s[1], sx * 1.131971753677421, kRounding);
    }
  }
  EXPECT_NEAR(1.131971753677421, kPi / 4 + kLn2 / 2, kRounding);
  EXPECT_NEAR(kernel.circulation(0, 0), 4.527887014709684, kRounding);
  EXPECT_NEAR(kernel.peak_circulation(), 4.527887014709684, kRounding);
  EXPECT_NEAR(kPi + 2 * kLn2, 4.527887014709684, kRounding);
  EXPECT_EQ(kernel.charge(), 1);
  EXPECT_EQ(VortexKernel({kPi, 0.3}).charge(), -1);
  EXPECT_NEAR(VortexKernel({kPi, 0.3}).circulation(0, 0), -4.527887014709684, kRounding);
}

TEST(VortexKernel, TableOfPositions) {
  const VortexKernel round;
  const VortexKernel a({kPi / 4, kPi});
  const VortexKernel b({4 * kPi / 9, kPi / 2});
  struct Row {
    double t;
    std::array<double, 8> d;
  };
  constexpr std::array<Row, 7> kTable{{
      {0.00,
       {4.527887015, 4.527887015, 4.319619910, 4.319619910, 4.319619910, 5.524402127, 5.524402127,
        5.524402127}},
      {0.25,
       {3.740860224, 2.963584872, 3.515593304, 3.631243335, 2.836169882, 4.459546490, 3.964491932,
        3.128922027}},
      {0.50,
       {2.930779664, 1.486700586, 2.670063922, 3.049048722, 1.502488390, 3.129730452, 2.427911155,
        0.523797650}},
      {0.75,
       {2.031968415, 0.273949753, 1.766032759, 2.372219911, 0.303810379, 1.740338951, 0.921159305,
        0.005455978}},
      {1.00,
       {0.798362936, -0.396641031, 0.714401631, 0.956154540, -0.372368262, 0.404442259,
        -0.519330961, -0.041151445}},
      {1.50,
       {0.174057874, -0.051641271, 0.310083882, 0.082030878, -0.015548213, 0.020794367,
        -0.327410055, -0.003078291}},
      {2.00,
       {0.059602407, -0.015835041, 0.164799550, 0.020318680, -0.002326997, -0.020939851,
        -0.238704514, -0.000824540}},
  }};
  for (const Row& row : kTable) {
    SCOPED_TRACE("t = " + std::to_string(row.t));
    const double t = row.t;
    EXPECT_NEAR(round.circulation(t, 0), row.d[0], kHalf9);
    EXPECT_NEAR(round.circulation(t, t), row.d[1], kHalf9);
    EXPECT_NEAR(a.circulation(t, 0), row.d[2], kHalf9);
    EXPECT_NEAR(a.circulation(0, t), row.d[3], kHalf9);
    EXPECT_NEAR(a.circulation(t, t), row.d[4], kHalf9);
    EXPECT_NEAR(b.circulation(t, 0), row.d[5], kHalf9);
    EXPECT_NEAR(b.circulation(t, t), row.d[6], kHalf9);
    EXPECT_NEAR(b.circulation(t, -t), row.d[7], kHalf9);
  }
}

TEST(VortexKernel, AnyPositionAndMorphology) {
  EXPECT_NEAR(VortexKernel({0.7, 1.0}).circulation(0.3, 0.2), 3.079614607803, kHalf12);
  EXPECT_NEAR(VortexKernel({1.2, 2.5}).circulation(-0.4, 0.9), 0.531910621304, kHalf12);
  EXPECT_NEAR(VortexKernel({0.5, 5.5}).circulation(0.5, 0.5), 1.392803366873, kHalf12);
}

TEST(VortexKernel, TableOfPeaks) {
  struct Row {
    double alpha_deg;
    std::array<double, 3> d;
  };
  constexpr std::array<Row, 5> kTable{{{15, {4.506644, 4.527855, 4.549194}},
                                       {45, {4.319620, 4.524794, 4.742442}},
                                       {60, {4.124694, 4.516467, 4.955392}},
                                       {80, {3.655703, 4.481386, 5.524402}},
                                       {89, {3.233074, 4.447650, 6.130695}}}};
  for (const Row& row : kTable) {
    for (std::size_t i = 0; i < 3; ++i) {
      SCOPED_TRACE("alpha " + std::to_string(row.alpha_deg) + " beta " + std::to_string(45 * i));
      const VortexKernel kernel({radians(row.alpha_deg), radians(45.0 * static_cast<double>(i))});
      EXPECT_NEAR(kernel.peak_circulation(), row.d[i], kHalf6);
      // There are two formulas for one number. Both lose digits as the core becomes a line.
      EXPECT_NEAR(kernel.circulation(0, 0), kernel.peak_circulation(), 1e-12);
    }
  }
}

TEST(VortexKernel, DiagonalValueMinimumAndZero) {
  const VortexKernel kernel;
  for (const double t : {-1.0, 1.0}) {
    for (const double u : {-1.0, 1.0}) {
      EXPECT_NEAR(kernel.circulation(t, u), -0.3966410308617583, 1e-14);
    }
  }
  double low = 0.8;  // Bisection finds the zero on the diagonal.
  double high = 0.85;
  for (int i = 0; i < 60; ++i) {
    const double middle = 0.5 * (low + high);
    (kernel.circulation(middle, middle) > 0.0 ? low : high) = middle;
  }
  EXPECT_NEAR(low, 0.82215773, kHalf8);

  // This is the minimum over the plane. A grid finds its basin, and golden sections along u = 1
  // find its place.
  double minimum = 0.0;
  double at_t = 0.0;
  double at_u = 0.0;
  for (int i = 0; i <= 120; ++i) {
    // The rest follows from u ≥ t by symmetry.
    for (int j = 0; j <= i; ++j) {
      const double t = 0.025 * j;
      const double u = 0.025 * i;
      if (kernel.circulation(t, u) < minimum) {
        minimum = kernel.circulation(t, u);
        at_t = t;
        at_u = u;
      }
    }
  }
  EXPECT_NEAR(at_t, 0.97, 0.026);  // This allows the grid's step.
  EXPECT_NEAR(at_u, 1.0, 0.026);
  double a = 0.9;
  double b = 1.0;
  for (int i = 0; i < 80; ++i) {
    const double p = a + 0.381966 * (b - a);
    const double q = a + 0.618034 * (b - a);
    if (kernel.circulation(p, 1) < kernel.circulation(q, 1)) {
      b = q;
    } else {
      a = p;
    }
  }
  EXPECT_NEAR(a, 0.971810, kHalf6);
  EXPECT_NEAR(kernel.circulation(a, 1), -0.4107301049, kHalf10);
  // The kernel has a crease along u = 1, and the minimum does not move off it.
  EXPECT_GT(kernel.circulation(a, 1 - 1e-4), kernel.circulation(a, 1));
  EXPECT_GT(kernel.circulation(a, 1 + 1e-4), kernel.circulation(a, 1));
  for (const double s : {-1.0, 1.0}) {
    EXPECT_NEAR(kernel.circulation(s * a, -s), kernel.circulation(a, 1), 1e-14);
    EXPECT_NEAR(kernel.circulation(s, a), kernel.circulation(a, 1), 1e-14);
  }
}

/// Returns the sum of D over the n×n cells, n = 2·half + 1, round the one from whose centre the
/// vortex is (t, u) away.
double cell_sum(const VortexKernel& kernel, double t, double u, int half) {
  double sum = 0.0;
  for (int r = -half; r <= half; ++r) {
    for (int c = -half; c <= half; ++c) sum += kernel.circulation(t - c, u - r);
  }
  return sum;
}

TEST(VortexKernel, SumsOverAllPositions) {
  const VortexKernel kernel;
  std::array<double, 4> minimum{1e9, 1e9, 1e9, 1e9};
  std::array<double, 4> maximum{};
  constexpr int kSteps = 64;
  for (int i = 0; i <= kSteps; ++i) {
    for (int j = 0; j <= kSteps; ++j) {
      const double t = -0.5 + static_cast<double>(i) / kSteps;
      const double u = -0.5 + static_cast<double>(j) / kSteps;
      double four = 0.0;  // Here (t, u) is taken from a lenslet's centre.
      for (const double dx : {-0.5, 0.5}) {
        for (const double dy : {-0.5, 0.5}) four += kernel.circulation(t + dx, u + dy);
      }
      const std::array<double, 4> sums{kernel.circulation(t, u), four, cell_sum(kernel, t, u, 1),
                                       cell_sum(kernel, t, u, 2)};
      for (std::size_t k = 0; k < 4; ++k) {
        minimum[k] = std::min(minimum[k], sums[k]);
        maximum[k] = std::max(maximum[k], sums[k]);
      }
    }
  }
  EXPECT_NEAR(minimum[0], 1.487, kHalf3);
  EXPECT_NEAR(maximum[0], 4.528, kHalf3);
  EXPECT_NEAR(minimum[1], 5.728, kHalf3);
  EXPECT_NEAR(maximum[1], 5.978, kHalf3);
  EXPECT_NEAR(minimum[2], 6.1249, kHalf4);
  EXPECT_NEAR(maximum[2], 6.1371, kHalf4);
  EXPECT_NEAR(minimum[3], 6.2294, kHalf4);
  EXPECT_NEAR(maximum[3], 6.2299, kHalf4);

  double mean = 0.0;  // This is the midpoint rule.
  for (int i = 0; i < kSteps; ++i) {
    for (int j = 0; j < kSteps; ++j) {
      mean += kernel.circulation(-0.5 + (i + 0.5) / kSteps, -0.5 + (j + 0.5) / kSteps);
    }
  }
  EXPECT_NEAR(mean / (kSteps * kSteps), 2.964, kHalf3);
}

TEST(VortexKernel, Dipoles) {
  const VortexKernel kernel;
  constexpr std::array<double, 7> kSeparation{0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0};
  constexpr std::array<double, 7> kD{0.787, 1.597, 2.496, 3.730, 4.354, 4.468, 4.516};
  for (std::size_t i = 0; i < kD.size(); ++i) {
    const double s = kSeparation[i];
    EXPECT_NEAR(kernel.circulation(0, 0) - kernel.circulation(s, 0), kD[i], kHalf3);
    EXPECT_NEAR(kernel.circulation(0, 0) - kernel.circulation(0, -s), kD[i], kHalf3);
  }
}

TEST(VortexKernel, PointSamplesGiveFour) {
  const VortexKernel kernel;
  const auto s = kernel.gradient(0.5, 0.5);
  EXPECT_DOUBLE_EQ(s[0], -1.0);
  EXPECT_DOUBLE_EQ(s[1], 1.0);  // Half of the sum of eight such components is 4.
}

TEST(VortexKernel, EdgeIntegralEqualsAreaIntegral) {
  // The quadrature in these tests rests on this identity, which is checked once by a plain double
  // integral.
  const Morphology m{0.9, 2.0};
  const auto inner = [&](double y) {
    return integrate([&](double x) { return gradient_of(m, x, y)[0]; }, 0.3, 1.3, 1e-11);
  };
  EXPECT_NEAR(integrate(inner, -0.4, 0.6, 1e-11), quadrature_mean(m, 0.3, -0.4, 1.3, 0.6)[0],
              1e-11);
}

TEST(VortexKernel, MeanGradientEqualsQuadrature) {
  constexpr unsigned kSeed = 20240501;
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  for (int trial = 0; trial < 200; ++trial) {
    const Morphology m{kPi * unit(random), 2 * kPi * unit(random)};
    if (std::abs(std::cos(m.alpha_rad)) < 0.02) continue;  // LimitLine tests these.
    const double x0 = 4 * unit(random) - 3;
    const double y0 = 4 * unit(random) - 3;
    const double x1 = x0 + 0.1 + 2 * unit(random);
    const double y1 = y0 + 0.1 + 2 * unit(random);
    SCOPED_TRACE("alpha " + std::to_string(m.alpha_rad) + " beta " + std::to_string(m.beta_rad) +
                 " x0 " + std::to_string(x0) + " y0 " + std::to_string(y0));
    const auto closed = VortexKernel(m).mean_gradient(x0, y0, x1, y1);
    const auto numeric = quadrature_mean(m, x0, y0, x1, y1);
    // The quadrature errs by 1e-14 a side, and the closed form is rounded. Both errors are divided
    // by an area down to .01.
    EXPECT_NEAR(closed[0], numeric[0], 2e-11);
    EXPECT_NEAR(closed[1], numeric[1], 2e-11);
  }
}

TEST(VortexKernel, CirculationEqualsQuadratureAlsoWhereThePapersFormIsZeroByZero) {
  for (const double alpha : {0.0, 0.3, 1.4, 2.2}) {
    for (const double beta : {0.0, kPi / 2, 4.0}) {
      const Morphology m{alpha, beta};
      const VortexKernel kernel(m);
      for (const double t : {-1.0, 0.0, 0.3, 1.0, 2.5}) {
        for (const double u : {-1.0, 0.0, 0.7, 4.0}) {
          SCOPED_TRACE("alpha " + std::to_string(alpha) + " beta " + std::to_string(beta) + " t " +
                       std::to_string(t) + " u " + std::to_string(u));
          // The 32 sides err by 1e-14 each, and the closed form by 1e-14.
          EXPECT_NEAR(kernel.circulation(t, u), quadrature_circulation(m, t, u), 5e-13);
        }
      }
    }
  }
}

TEST(VortexKernel, NearlyALineEqualsQuadrature) {
  // The core is 1e-3 rad from the limit line, at every place where the kernel guards a quotient: A−
  // → 0, C → 0 alone, and A+ → 0.
  for (const double beta : {0.0, 1e-4, kPi / 2, 1.1, kPi, 1.5 * kPi}) {
    for (const double alpha : {kPi / 2 - 1e-3, kPi / 2 + 1e-3}) {
      const Morphology m{alpha, beta};
      const VortexKernel kernel(m);
      for (const double t : {0.0, 0.31, 1.0}) {
        for (const double u : {0.0, -0.2, 0.87}) {
          SCOPED_TRACE("beta " + std::to_string(beta) + " t " + std::to_string(t) + " u " +
                       std::to_string(u));
          // The closed form may err by 4e-13. The quadrature errs more, because its integrand
          // varies over 1e-3 and reaches 1e3.
          EXPECT_NEAR(kernel.circulation(t, u), quadrature_circulation(m, t, u), 5e-12);
        }
      }
    }
  }
}

TEST(VortexKernel, LimitLine) {
  // At α → 90° the phase is a step of π across the slow axis. For β = 0 the step is at x = 0, and
  // counting it in each lenslet gives D(t, u) = π(1 − |u|) inside the cell. β = π turns it by 90°.
  for (const double off : {1e-6, 1e-9, 1e-12, 0.0}) {
    SCOPED_TRACE("90 deg less " + std::to_string(off));
    // The limit is approached as ε·ln(1/ε). With cancellation, rounding would be 5e-7 at 1e-9 rad;
    // A± without cancellation and log1p leave less.
    const double tolerance = 1e-9 + (off > 0.0 ? 3 * off * (1 - std::log(off)) : 0.0);
    const VortexKernel zero({kPi / 2 - off, 0.0});
    const VortexKernel pi({kPi / 2 - off, kPi});
    for (const double t : {-0.6, 0.3, 0.5}) {
      for (const double u : {-0.2, 0.4, 0.9}) {
        EXPECT_NEAR(zero.circulation(t, u), kPi * (1 - std::abs(u)), tolerance);
        EXPECT_NEAR(pi.circulation(t, u), kPi * (1 - std::abs(t)), tolerance);
      }
    }
    EXPECT_NEAR(zero.peak_circulation(), kPi, tolerance);
    EXPECT_NEAR(pi.peak_circulation(), kPi, tolerance);
    EXPECT_NEAR(VortexKernel({kPi / 2 - off, kPi / 2}).peak_circulation(), 2 * kPi, tolerance);
    EXPECT_NEAR(VortexKernel({kPi / 2 - off, 1.5 * kPi}).peak_circulation(), 2 * kPi, tolerance);
    EXPECT_NEAR(VortexKernel({kPi / 2 - off, kPi / 2}).circulation(0, 0), 2 * kPi, tolerance);
  }
}

TEST(VortexKernel, FiniteEverywhere) {
  for (const double alpha : {0.0, 1e-300, 1e-9, kPi / 2, std::nextafter(kPi / 2, 2.0), kPi, -1.0}) {
    for (const double beta : {0.0, kPi / 2, kPi, 1.5 * kPi, 2 * kPi}) {
      const VortexKernel kernel({alpha, beta});
      EXPECT_TRUE(std::isfinite(kernel.peak_circulation())) << alpha << " " << beta;
      for (const double t : {-1e6, -1.0, 0.0, 1e-12, 1.0, 60.0, 1e3}) {
        for (const double u : {-1e6, -1.0, 0.0, 1e-12, 1.0, 60.0, 1e3}) {
          EXPECT_TRUE(std::isfinite(kernel.circulation(t, u)))
              << alpha << " " << beta << " " << t << " " << u;
        }
      }
    }
  }
}

TEST(VortexKernel, AsymptoteJoinsSmoothly) {
  for (const double alpha : {0.0, 0.4, 1.0, 1.3, 1.5, 2.0, kPi}) {
    for (const double beta : {0.0, 0.9, kPi / 2, 2.5, 4.4}) {
      const VortexKernel kernel({alpha, beta});
      for (int i = 0; i < 24; ++i) {
        const double direction = 2 * kPi * (i + 0.3) / 24;
        const double x = std::cos(direction);
        const double y = std::sin(direction);
        // |u| grows in proportion to the distance.
        const double u_x = std::cos(alpha / 2) * std::cos(direction + beta / 2) +
                           std::sin(alpha / 2) * std::cos(direction + beta / 2);
        const double u_y = std::cos(alpha / 2) * std::sin(direction + beta / 2) -
                           std::sin(alpha / 2) * std::sin(direction + beta / 2);
        const double r = VortexKernel::kAsymptoteFrom / std::hypot(u_x, u_y);
        SCOPED_TRACE("alpha " + std::to_string(alpha) + " beta " + std::to_string(beta) +
                     " direction " + std::to_string(direction));
        // Both branches are taken, one on each side.
        const double inside = r * (1 - 1e-9);
        const double outside = r * (1 + 1e-9);
        EXPECT_EQ(kernel.circulation(inside * x, inside * y),
                  kernel.circulation_closed_form(inside * x, inside * y));
        EXPECT_EQ(kernel.circulation(outside * x, outside * y),
                  kernel.circulation_asymptote(outside * x, outside * y));
        // They meet. D is 1e-7 there, and the asymptote's neglected terms are 1e-14. The closed
        // form's rounding is 1e-14 and grows with the distance along a slow axis.
        const double step = kernel.circulation(outside * x, outside * y) -
                            kernel.circulation(inside * x, inside * y);
        EXPECT_LT(std::abs(step), 1e-13 + 1e-15 * r);
      }
    }
  }
}

TEST(VortexKernel, AsymptoteIsTheFarField) {
  // The far field is cos(4φ)/r⁴ with a relative error near .8/r⁴.
  const VortexKernel kernel;
  for (const double r : {6.0, 10.0, 16.0}) {
    const double exact = kernel.circulation_closed_form(r, 0);
    EXPECT_NEAR(exact * std::pow(r, 4), 1.0, 1.0 / std::pow(r, 4));
    EXPECT_NEAR(kernel.circulation_closed_form(r * std::cos(kPi / 4), r * std::sin(kPi / 4)) *
                    std::pow(r, 4),
                -1.0, 1.0 / std::pow(r, 4));
  }
  // The closed form stays accurate in absolute terms.
  EXPECT_NEAR(kernel.circulation_closed_form(1000, 0), 1e-12, 1e-12);
}

TEST(VortexKernel, Symmetries) {
  constexpr unsigned kSeed = 7;
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  for (int trial = 0; trial < 200; ++trial) {
    const double alpha = 1.5 * unit(random);
    const double beta = 2 * kPi * unit(random);
    const double t = 4 * unit(random) - 2;
    const double u = 4 * unit(random) - 2;
    const VortexKernel kernel({alpha, beta});
    const double d = kernel.circulation(t, u);
    // α reaches 1.5, where the closed form loses some digits.
    constexpr double kRounding = 1e-12;
    // These are half a turn, a quarter turn, a mirrored core, the opposite charge and a negative α.
    EXPECT_NEAR(kernel.circulation(-t, -u), d, kRounding);
    EXPECT_NEAR(VortexKernel({alpha, beta + kPi}).circulation(-u, t), d, kRounding);
    EXPECT_NEAR(VortexKernel({alpha, -beta}).circulation(t, -u), d, kRounding);
    EXPECT_NEAR(VortexKernel({kPi - alpha, beta}).circulation(t, u), -d, kRounding);
    EXPECT_NEAR(VortexKernel({-alpha, beta + kPi}).circulation(t, u), d, kRounding);
  }
}

}  // namespace
}  // namespace curlew
