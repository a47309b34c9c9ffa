#include "reconstruct/split.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <random>

#include "tests/support/pupils.h"

namespace curlew {
namespace {

using testing::annular_pupil;
using testing::knock_out;
using testing::Mask;
using testing::pupil_from;
using testing::round_pupil;
using testing::square_pupil;

// Each slope in float carries a relative error of 6e-8. Γφ takes differences of φ, whose size grows
// with the pupil. 40 rounding errors of the largest slope cover every pupil here.
constexpr double kRounding = 40 * 6e-8;

SlopeField random_slopes(const Mask& valid, std::mt19937& random, bool random_variance = false) {
  SlopeField slopes(valid.rows(), valid.cols());
  std::normal_distribution<float> normal;
  std::uniform_real_distribution<float> spread(0.05F, 2.0F);
  for (std::size_t k = 0; k < valid.size(); ++k) {
    slopes.valid[k] = valid[k];
    if (valid[k] == 0) continue;
    ++slopes.n_valid;
    slopes.x[k] = normal(random);
    slopes.y[k] = normal(random);
    slopes.variance_x[k] = random_variance ? spread(random) : 1.0F;
    slopes.variance_y[k] = random_variance ? spread(random) : 1.0F;
  }
  return slopes;
}

/// Returns the curl-free slopes [x then y of each valid lenslet] by a dense least-squares solve in
/// double. It is written from the definition: corner differences and minimum norm.
Eigen::VectorXd dense_curl_free(const SlopeField& slopes, bool weighted) {
  const int rows = slopes.rows();
  const int cols = slopes.cols();
  std::vector<std::pair<int, int>> lenslets;
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c)
      if (slopes.valid(r, c) != 0) lenslets.emplace_back(r, c);
  const auto m = static_cast<Eigen::Index>(lenslets.size());
  Eigen::MatrixXd gamma = Eigen::MatrixXd::Zero(2 * m, (rows + 1) * (cols + 1));
  Eigen::VectorXd s(2 * m);
  Eigen::VectorXd root_weight(2 * m);
  for (Eigen::Index i = 0; i < m; ++i) {
    const int r = lenslets[static_cast<std::size_t>(i)].first;
    const int c = lenslets[static_cast<std::size_t>(i)].second;
    const auto node = [&](int dr, int dc) { return (r + dr) * (cols + 1) + c + dc; };
    for (const int d : {0, 1}) {
      gamma(2 * i, node(d, 1)) += 0.5;
      gamma(2 * i, node(d, 0)) -= 0.5;
      gamma(2 * i + 1, node(1, d)) += 0.5;
      gamma(2 * i + 1, node(0, d)) -= 0.5;
    }
    s(2 * i) = static_cast<double>(slopes.x(r, c));
    s(2 * i + 1) = static_cast<double>(slopes.y(r, c));
    const double variance =
        static_cast<double>(slopes.variance_x(r, c)) + static_cast<double>(slopes.variance_y(r, c));
    root_weight(2 * i) = root_weight(2 * i + 1) = weighted ? std::sqrt(2.0 / variance) : 1.0;
  }
  const Eigen::MatrixXd a = root_weight.asDiagonal() * gamma;
  const Eigen::VectorXd phi =
      a.completeOrthogonalDecomposition().solve(root_weight.asDiagonal() * s);
  return gamma * phi;
}

HodgeSplit split_of(const Mask& plan_mask, const SlopeField& slopes, SplitOptions options = {}) {
  const SplitPlan plan(plan_mask, options);
  SplitWorkspace workspace(plan);
  HodgeSplit split(plan_mask.rows(), plan_mask.cols());
  split_slopes(plan, slopes, workspace, split);
  return split;
}

/// Returns D of detect/circulation.h in double, and NaN where a lenslet is missing.
double circulation(const Image<float>& x, const Image<float>& y, const Mask& valid, int r, int c) {
  if (valid(r, c) == 0 || valid(r, c + 1) == 0 || valid(r + 1, c) == 0 || valid(r + 1, c + 1) == 0)
    return std::nan("");
  const auto d = [](float v) { return static_cast<double>(v); };
  return 0.5 * (d(x(r, c)) + d(x(r, c + 1)) + d(y(r, c + 1)) + d(y(r + 1, c + 1)) -
                d(x(r + 1, c + 1)) - d(x(r + 1, c)) - d(y(r + 1, c)) - d(y(r, c)));
}

void expect_exact_split(const Mask& plan_mask, const SlopeField& slopes, const HodgeSplit& split,
                        bool weighted) {
  const Eigen::VectorXd expected = dense_curl_free(slopes, weighted);
  double error = 0.0;
  double largest = 0.0;
  double inner = 0.0;
  double norm = 0.0;
  Eigen::Index i = 0;
  for (std::size_t k = 0; k < plan_mask.size(); ++k) {
    if (slopes.valid[k] == 0) {
      EXPECT_EQ(split.curl_free_x[k], 0.0F);
      EXPECT_EQ(split.solenoidal_y[k], 0.0F);
      EXPECT_EQ(split.phase[k], 0.0F);
      continue;
    }
    const double x = static_cast<double>(split.curl_free_x[k]);
    const double y = static_cast<double>(split.curl_free_y[k]);
    const double sx = static_cast<double>(split.solenoidal_x[k]);
    const double sy = static_cast<double>(split.solenoidal_y[k]);
    error = std::max({error, std::abs(x - expected(2 * i)), std::abs(y - expected(2 * i + 1))});
    largest = std::max({largest, std::abs(expected(2 * i)), std::abs(expected(2 * i + 1)),
                        std::abs(static_cast<double>(slopes.x[k])),
                        std::abs(static_cast<double>(slopes.y[k]))});
    ++i;
    const double variance = static_cast<double>(slopes.variance_x[k] + slopes.variance_y[k]);
    const double w = weighted ? 2.0 / variance : 1.0;
    inner += w * (x * sx + y * sy);
    norm += w * (x * x + y * y + sx * sx + sy * sy);
    EXPECT_NEAR(x + sx, static_cast<double>(slopes.x[k]), kRounding * largest);
    EXPECT_NEAR(y + sy, static_cast<double>(slopes.y[k]), kRounding * largest);
  }
  // The split must be within 1e-5 of a dense double solve, relative to the largest slope.
  EXPECT_LT(error, 1e-5 * largest);
  // Conjugate gradients stop at 1e-6 of the fit's energy, and leave as much of the inner product.
  EXPECT_LT(std::abs(inner), (split.iterations > 0 ? 4e-6 : kRounding) * norm);
  for (int r = 0; r + 1 < plan_mask.rows(); ++r)
    for (int c = 0; c + 1 < plan_mask.cols(); ++c) {
      const double measured = circulation(slopes.x, slopes.y, slopes.valid, r, c);
      if (std::isnan(measured)) continue;
      EXPECT_NEAR(circulation(split.curl_free_x, split.curl_free_y, slopes.valid, r, c), 0.0,
                  kRounding * largest);
      EXPECT_NEAR(circulation(split.solenoidal_x, split.solenoidal_y, slopes.valid, r, c), measured,
                  kRounding * largest);
    }
}

std::vector<std::pair<const char*, Mask>> pupils() {
  return {{"square", square_pupil(12)},
          {"round", round_pupil(14)},
          {"obscured", annular_pupil(14, 0.35)},
          {"one lenslet", pupil_from({"#"})},
          {"isolated", pupil_from({"#....", "..###", "..###", "..###"})},
          {"corner only", pupil_from({"###...", "###...", "###...", "...###", "...###"})},
          {"bridge", pupil_from({"###..###", "########", "###..###"})},
          {"holes at a corner",
           pupil_from({"######", "######", "##.###", "###.##", "######", "######"})},
          {"row", pupil_from({"#######"})}};
}

TEST(Split, EqualsDenseSolveOnEveryPupil) {
  std::mt19937 random(7001);
  SCOPED_TRACE("seed 7001");
  for (const auto& [name, mask] : pupils()) {
    SCOPED_TRACE(name);
    const SlopeField slopes = random_slopes(mask, random);
    const HodgeSplit split = split_of(mask, slopes);
    EXPECT_EQ(split.iterations, 0);
    expect_exact_split(mask, slopes, split, false);
  }
}

TEST(Split, LensletsThatFadeAreLeftOutExactly) {
  std::mt19937 random(7002);
  SCOPED_TRACE("seed 7002");
  for (const auto& [name, mask] : pupils())
    for (const double probability : {0.02, 0.1, 0.4}) {
      SCOPED_TRACE(std::string(name) + " fading " + std::to_string(probability));
      const SlopeField slopes = random_slopes(knock_out(mask, probability, random), random);
      const HodgeSplit split = split_of(mask, slopes);
      EXPECT_TRUE(split.converged);
      expect_exact_split(mask, slopes, split, false);
    }
}

TEST(Split, WeightsByVariance) {
  std::mt19937 random(7003);
  SCOPED_TRACE("seed 7003");
  SplitOptions options;
  options.weighted = true;
  for (const auto& [name, mask] : pupils())
    for (const double probability : {0.0, 0.1}) {
      SCOPED_TRACE(std::string(name) + " fading " + std::to_string(probability));
      const SlopeField slopes = random_slopes(knock_out(mask, probability, random), random, true);
      const HodgeSplit split = split_of(mask, slopes, options);
      EXPECT_TRUE(split.converged);
      expect_exact_split(mask, slopes, split, true);
    }
}

TEST(Split, AFadeThatSplitsAComponent) {
  const Mask mask = pupil_from({"###.###", "#######", "###.###"});
  std::mt19937 random(7004);
  SlopeField slopes = random_slopes(mask, random);
  slopes.valid(1, 3) = 0;  // This takes the bridge away.
  slopes.x(1, 3) = slopes.y(1, 3) = 0.0F;
  const HodgeSplit split = split_of(mask, slopes);
  EXPECT_TRUE(split.converged);
  expect_exact_split(mask, slopes, split, false);
  // Each half has its own mean zero.
  for (const int first : {0, 4}) {
    double sum = 0.0;
    for (int r = 0; r < 3; ++r)
      for (int c = first; c < first + 3; ++c) sum += static_cast<double>(split.phase(r, c));
    EXPECT_NEAR(sum, 0.0, 1e-5);
  }
}

TEST(Split, PhaseOfAKnownPolynomial) {
  // The slopes are Γ of φ = a x + b y + c x² + d x y at the corners. The mean of x² over four
  // corners exceeds the centre's value by the constant ¼, which mean zero removes.
  const int n = 80;
  const Mask mask = round_pupil(n);
  SlopeField slopes(n, n);
  slopes.valid = mask;
  const auto phi = [](double x, double y) {
    return 3.0 * x - 2.0 * y + 0.02 * x * x + 0.01 * x * y;
  };
  double mean = 0.0;
  int count = 0;
  for (int r = 0; r < n; ++r)
    for (int c = 0; c < n; ++c) {
      if (mask(r, c) == 0) continue;
      slopes.x(r, c) = static_cast<float>(3.0 + 0.04 * c + 0.01 * r);
      slopes.y(r, c) = static_cast<float>(-2.0 + 0.01 * c);
      mean += phi(c, r);
      ++count;
    }
  const HodgeSplit split = split_of(mask, slopes);
  for (int r = 0; r < n; ++r)
    for (int c = 0; c < n; ++c)
      if (mask(r, c) != 0) {
        // Float slopes of up to 6 are summed over 80 pitches, which makes 300 rad. The phase is
        // accurate to 2e-5 of that.
        EXPECT_NEAR(static_cast<double>(split.phase(r, c)), phi(c, r) - mean / count, 6e-3);
        EXPECT_NEAR(static_cast<double>(split.solenoidal_x(r, c)), 0.0, 1e-5);
        EXPECT_NEAR(static_cast<double>(split.solenoidal_y(r, c)), 0.0, 1e-5);
      }
}

TEST(Split, PotentialGivesTheSolenoidalSlopes) {
  // In cells all round a lenslet, w·s_sol = (−∂ψ/∂y, ∂ψ/∂x) by the differences of the lattice.
  std::mt19937 random(7005);
  SCOPED_TRACE("seed 7005");
  const Mask mask = annular_pupil(14, 0.3);
  const SlopeField slopes = random_slopes(mask, random);
  const HodgeSplit split = split_of(mask, slopes);
  int checked = 0;
  for (int r = 1; r + 1 < mask.rows(); ++r)
    for (int c = 1; c + 1 < mask.cols(); ++c) {
      if (mask(r, c) == 0) continue;
      const auto psi = [&](int dr, int dc) {
        return static_cast<double>(split.potential(r - 1 + dr, c - 1 + dc));
      };
      const double a = psi(0, 1) - psi(1, 0);
      const double b = psi(1, 1) - psi(0, 0);
      EXPECT_NEAR(static_cast<double>(split.solenoidal_x(r, c)), 0.5 * (a - b), 3e-5);
      EXPECT_NEAR(static_cast<double>(split.solenoidal_y(r, c)), 0.5 * (a + b), 3e-5);
      ++checked;
    }
  EXPECT_GT(checked, 80);
}

TEST(Split, PositiveVortexIsAMinimumOfThePotential) {
  const Mask mask = square_pupil(8);
  SlopeField slopes(8, 8);
  slopes.valid = mask;
  for (int r = 0; r < 8; ++r)
    for (int c = 0; c < 8; ++c) {
      const double x = c - 3.5;
      const double y = r - 3.5;
      slopes.x(r, c) = static_cast<float>(-y / (x * x + y * y));
      slopes.y(r, c) = static_cast<float>(x / (x * x + y * y));
    }
  const HodgeSplit split = split_of(mask, slopes);
  for (const float psi : split.potential) EXPECT_GE(psi, split.potential(3, 3));
  EXPECT_LT(split.potential(3, 3), -1.0F);
}

TEST(Split, CirculationRoundAHole) {
  // The phase differences are those of a charge in the middle of a hole, so that every loop
  // encloses 2π. Edge A of a lenslet is φ11 − φ00 and edge B is φ10 − φ01; each is the angle seen
  // from the charge.
  for (const auto& [charge, size] : {std::pair{1, 1}, {-1, 1}, {1, 2}, {-1, 3}}) {
    Mask mask = square_pupil(9);
    for (int r = 3; r < 3 + size; ++r)
      for (int c = 3; c < 3 + size; ++c) mask(r, c) = 0;
    const double x0 = 3.0 + 0.5 * (size - 1);
    const auto angle = [&](double x, double y) { return std::atan2(y - x0 - 0.02, x - x0 - 0.01); };
    const auto turn = [&](double to, double from) { return std::remainder(to - from, 2 * M_PI); };
    SlopeField slopes(9, 9);
    slopes.valid = mask;
    for (int r = 0; r < 9; ++r)
      for (int c = 0; c < 9; ++c) {
        if (mask(r, c) == 0) continue;
        const double a = charge * turn(angle(c + 0.5, r + 0.5), angle(c - 0.5, r - 0.5));
        const double b = charge * turn(angle(c - 0.5, r + 0.5), angle(c + 0.5, r - 0.5));
        slopes.x(r, c) = static_cast<float>(0.5 * (a - b));
        slopes.y(r, c) = static_cast<float>(0.5 * (a + b));
      }
    const HodgeSplit split = split_of(mask, slopes);
    ASSERT_EQ(split.holes.size(), 1U);
    EXPECT_NEAR(static_cast<double>(split.holes[0].circulation), charge * 2 * M_PI, 1e-5);
    EXPECT_FALSE(split.holes[0].one_sublattice);
    EXPECT_NEAR(static_cast<double>(split.holes[0].x), x0, 1e-6);
    EXPECT_NEAR(static_cast<double>(split.holes[0].y), x0, 1e-6);

    // A fade that makes the same hole gives the same circulation.
    SplitOptions options;
    const HodgeSplit faded = split_of(square_pupil(9), slopes, options);
    ASSERT_EQ(faded.holes.size(), 1U);
    EXPECT_NEAR(static_cast<double>(faded.holes[0].circulation), charge * 2 * M_PI, 1e-5);
  }
}

TEST(Split, NothingLitIsRefused) { EXPECT_ANY_THROW(SplitPlan(Mask(4, 4, 0), {})); }

TEST(Split, AllFadedGivesZeros) {
  const Mask mask = square_pupil(4);
  const HodgeSplit split = split_of(mask, SlopeField(4, 4));
  for (const float v : split.phase) EXPECT_EQ(v, 0.0F);
  for (const float v : split.solenoidal_x) EXPECT_EQ(v, 0.0F);
  for (const float v : split.potential) EXPECT_EQ(v, 0.0F);
}

TEST(Split, TiltDoesNotLeak) {
  // A tilt of 100 rad per pitch is a gradient, and nothing of it may leak into the solenoidal part.
  const Mask mask = round_pupil(40);
  SlopeField slopes(40, 40);
  slopes.valid = mask;
  for (std::size_t k = 0; k < mask.size(); ++k)
    if (mask[k] != 0) slopes.x[k] = 100.0F;
  const HodgeSplit split = split_of(mask, slopes);
  for (const float v : split.solenoidal_x) EXPECT_NEAR(v, 0.0F, 1e-5F);
}

// Lenslets of one row cut a square pupil in two, and a lone one hangs on nothing.
TEST(Split, IslandsAreNumberedByTheirSizes) {
  const Mask pupil = square_pupil(9);
  const SplitPlan plan(pupil, {});
  SplitWorkspace workspace(plan);
  HodgeSplit split(9, 9);
  std::mt19937 random(5);
  SlopeField slopes = random_slopes(pupil, random);
  split_slopes(plan, slopes, workspace, split);
  EXPECT_EQ(split.n_islands, 1);
  EXPECT_EQ(split.n_large_islands, 1);
  EXPECT_EQ(*std::max_element(split.island.begin(), split.island.end()), 0);
  for (int c = 0; c < 9; ++c) slopes.valid(3, c) = 0;  // 3 rows above, 5 below
  for (int r = 0; r < 2; ++r) slopes.valid(r, 1) = 0;  // (0, 0) and (1, 0) hang on (2, 0)
  slopes.valid(2, 0) = slopes.valid(2, 1) = 0;         // and now they are alone
  split_slopes(plan, slopes, workspace, split);
  EXPECT_EQ(split.n_islands, 3);
  EXPECT_EQ(split.n_large_islands, 2);
  EXPECT_EQ(split.island(8, 8), 0);
  EXPECT_EQ(split.island(0, 8), 1);
  EXPECT_EQ(split.island(0, 0), 2);
  EXPECT_EQ(split.island(3, 4), HodgeSplit::kNoIsland);
  std::array<double, 3> sum{};
  for (std::size_t k = 0; k < split.island.size(); ++k)
    if (split.island[k] >= 0)
      sum[static_cast<std::size_t>(split.island[k])] += static_cast<double>(split.phase[k]);
  for (const double s : sum) EXPECT_NEAR(s, 0.0, 1e-3);
}

}  // namespace
}  // namespace curlew
