// The split by all its solvers, against double, on pupils large enough for tiles, lines and
// corrections.
#include <gtest/gtest.h>

#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>
#include <random>
#include <string>

#include "core/lattice.h"
#include "reconstruct/split.h"
#include "tests/support/pupils.h"

namespace curlew {
namespace {

using testing::annular_pupil;
using testing::knock_out;
using testing::Mask;
using testing::pupil_from;
using testing::round_pupil;
using testing::square_pupil;

double to_double(float value) { return static_cast<double>(value); }

SlopeField slopes_on(const Mask& valid, std::mt19937& random) {
  SlopeField slopes(valid.rows(), valid.cols());
  std::normal_distribution<float> noise(0.0F, 0.3F);
  slopes.valid = valid;
  for (int r = 0; r < valid.rows(); ++r) {
    for (int c = 0; c < valid.cols(); ++c) {
      if (valid(r, c) == 0) continue;
      ++slopes.n_valid;
      slopes.x(r, c) = std::sin(0.1F * static_cast<float>(c)) + noise(random);
      slopes.y(r, c) = std::cos(0.07F * static_cast<float>(r)) + noise(random);
      slopes.variance_x(r, c) = slopes.variance_y(r, c) = 1.0F;
    }
  }
  return slopes;
}

/// Gives every lenslet a variance of 10^(±decades/2), at random.
void spread_variance(SlopeField& slopes, double decades, std::mt19937& random) {
  std::uniform_real_distribution<double> power(-0.5 * decades, 0.5 * decades);
  for (std::size_t k = 0; k < slopes.valid.size(); ++k)
    slopes.variance_x[k] = slopes.variance_y[k] =
        static_cast<float>(slopes.valid[k] == 0 ? 0.0 : std::pow(10.0, power(random)));
}

/// Removes crosses of five lenslets until `part` of all has gone.
Mask knock_out_crosses(Mask mask, double part, std::mt19937& random) {
  std::uniform_int_distribution<int> row(1, mask.rows() - 2);
  std::uniform_int_distribution<int> col(1, mask.cols() - 2);
  for (int n = static_cast<int>(part * static_cast<double>(mask.size())); n > 0; n -= 5) {
    const int r = row(random);
    const int c = col(random);
    mask(r, c) = mask(r - 1, c) = mask(r + 1, c) = mask(r, c - 1) = mask(r, c + 1) = 0;
  }
  return mask;
}

/// Returns the potential at the corners by a sparse factor in double, refined once. One node of
/// every component is 0.
Eigen::VectorXd potential_in_double(const SlopeField& slopes, bool weighted) {
  Lattice lattice(slopes.rows(), slopes.cols());
  lattice.build(slopes.valid);
  const int n = lattice.n_corners();
  std::vector<bool> tied(static_cast<std::size_t>(n), true);
  std::vector<bool> seen(static_cast<std::size_t>(lattice.n_components()), false);
  for (int corner = 0; corner < n; ++corner) {
    if (lattice.component_of(corner) < 0) continue;
    const auto component = static_cast<std::size_t>(lattice.component_of(corner));
    tied[static_cast<std::size_t>(corner)] = !seen[component];
    seen[component] = true;
  }
  struct Edge {
    int from, to;
    double weight, value;
  };
  std::vector<Edge> edges;
  std::vector<Eigen::Triplet<double>> entries;
  for (int corner = 0; corner < n; ++corner)
    if (tied[static_cast<std::size_t>(corner)]) entries.emplace_back(corner, corner, 1.0);
  for (int k = 0; k < slopes.rows() * slopes.cols(); ++k) {
    const auto i = static_cast<std::size_t>(k);
    if (slopes.valid[i] == 0) continue;
    const double w = weighted ? 1.0 / to_double(slopes.variance_x[i]) : 1.0;
    const double x = to_double(slopes.x[i]);
    const double y = to_double(slopes.y[i]);
    const auto c = lattice.corners_of(k);
    for (const Edge& edge : {Edge{c[0], c[3], w, x + y}, Edge{c[1], c[2], w, y - x}}) {
      edges.push_back(edge);
      const bool from_tied = tied[static_cast<std::size_t>(edge.from)];
      const bool to_tied = tied[static_cast<std::size_t>(edge.to)];
      if (!from_tied) entries.emplace_back(edge.from, edge.from, w);
      if (!to_tied) entries.emplace_back(edge.to, edge.to, w);
      if (!from_tied && !to_tied)
        entries.emplace_back(std::max(edge.from, edge.to), std::min(edge.from, edge.to), -w);
    }
  }
  Eigen::SparseMatrix<double> a(n, n);
  a.setFromTriplets(entries.begin(), entries.end());
  const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> factor(a);
  Eigen::VectorXd phi = Eigen::VectorXd::Zero(n);
  for (int pass = 0; pass < 2; ++pass) {
    Eigen::VectorXd b = Eigen::VectorXd::Zero(n);
    for (const Edge& edge : edges) {
      const double missing = edge.weight * (edge.value - (phi[edge.to] - phi[edge.from]));
      if (!tied[static_cast<std::size_t>(edge.from)]) b[edge.from] -= missing;
      if (!tied[static_cast<std::size_t>(edge.to)]) b[edge.to] += missing;
    }
    phi += factor.solve(b);
  }
  return phi;
}

/// Returns the largest error of a curl-free slope, as a part of the largest slope.
double error_of(const HodgeSplit& split, const SlopeField& slopes, bool weighted) {
  const Eigen::VectorXd phi = potential_in_double(slopes, weighted);
  const int across = slopes.cols() + 1;
  double worst = 0.0;
  double largest = 1e-30;
  for (int r = 0; r < slopes.rows(); ++r) {
    for (int c = 0; c < slopes.cols(); ++c) {
      if (slopes.valid(r, c) == 0) continue;
      const int corner = r * across + c;
      const double a = phi[corner + across + 1] - phi[corner];
      const double b = phi[corner + across] - phi[corner + 1];
      worst = std::max({worst, std::abs(to_double(split.curl_free_x(r, c)) - 0.5 * (a - b)),
                        std::abs(to_double(split.curl_free_y(r, c)) - 0.5 * (a + b))});
      largest = std::max(
          {largest, std::abs(to_double(slopes.x(r, c))), std::abs(to_double(slopes.y(r, c)))});
    }
  }
  return worst / largest;
}

/// A plan with its workspace and result.
struct Fit {
  explicit Fit(const Mask& pupil, const SplitOptions& options = {})
      : plan(pupil, options), workspace(plan), split(pupil.rows(), pupil.cols()) {}
  const HodgeSplit& operator()(const SlopeField& slopes) {
    split_slopes(plan, slopes, workspace, split);
    return split;
  }
  SplitPlan plan;
  SplitWorkspace workspace;
  HodgeSplit split;
};

TEST(SplitSolvers, AreExactAtEverySizeAndFade) {
  std::mt19937 random(7101);
  for (const auto& [name, pupil] : {std::pair{"obscured 80", annular_pupil(80, 0.28)},
                                    {"round 40", round_pupil(40)},
                                    {"square 33", square_pupil(33)},
                                    {"wide", Mask(5, 70, 1)},
                                    {"tall", Mask(61, 1, 1)}}) {
    Fit fit(pupil);
    Mask one = pupil;
    one(pupil.rows() / 3, pupil.cols() / 4) = 0;
    const auto left = [&random, &pupil = pupil](double part) {
      return knock_out(pupil, part, random);
    };
    const std::vector<std::pair<std::string, Mask>> frames = {
        {"none", pupil},
        {"one", one},
        {"1 %", left(0.01)},
        {"5 %", left(0.05)},
        {"40 %", left(0.4)},
        {"most", left(0.97)},
        {"crosses", std::min(pupil.rows(), pupil.cols()) > 4
                        ? knock_out_crosses(pupil, 0.02, random)
                        : left(0.02)}};
    for (const auto& [fade, valid] : frames) {
      SCOPED_TRACE(std::string(name) + ", faded: " + fade);
      const SlopeField slopes = slopes_on(valid, random);
      const HodgeSplit& split = fit(slopes);
      EXPECT_TRUE(split.converged);
      EXPECT_LT(error_of(split, slopes, false), 1e-5);
    }
  }
}

TEST(SplitSolvers, AreExactForWeightsOverManyDecades) {
  std::mt19937 random(7102);
  for (const Mask& pupil : {annular_pupil(40, 0.28), square_pupil(17), Mask(3, 30, 1)}) {
    Fit fit(pupil, {.weighted = true});
    for (const double decades : {1.0, 4.0, 6.0}) {
      for (const double faded : {0.0, 0.05, 0.5}) {
        SCOPED_TRACE(std::to_string(pupil.rows()) + " rows, 10^" + std::to_string(decades) +
                     ", faded " + std::to_string(faded));
        SlopeField slopes = slopes_on(knock_out(pupil, faded, random), random);
        spread_variance(slopes, decades, random);
        const HodgeSplit& split = fit(slopes);
        EXPECT_TRUE(split.converged);
        EXPECT_LT(error_of(split, slopes, true), 1e-5);
      }
    }
  }
}

TEST(SplitSolvers, AreExactOnPupilsOfAnyOutline) {
  std::mt19937 random(7103);
  std::uniform_int_distribution<int> side(1, 24);
  for (int trial = 0; trial < 60; ++trial) {
    const Mask pupil = knock_out(Mask(side(random), side(random), 1), 0.01 * trial, random);
    const bool weighted = trial % 2 == 0;
    SCOPED_TRACE("trial " + std::to_string(trial));
    Fit fit(pupil, {.weighted = weighted});
    SlopeField slopes = slopes_on(knock_out(pupil, 0.1, random), random);
    if (weighted) spread_variance(slopes, 3.0, random);
    const HodgeSplit& split = fit(slopes);
    EXPECT_TRUE(split.converged);
    EXPECT_LT(error_of(split, slopes, weighted), 1e-5);
  }
}

TEST(SplitSolvers, AreLinear) {
  std::mt19937 random(7104);
  const Mask pupil = annular_pupil(30, 0.3);
  for (const double faded : {0.0, 0.01, 0.2}) {
    Fit fit(pupil);
    const Mask valid = knock_out(pupil, faded, random);
    SlopeField first = slopes_on(valid, random);
    const SlopeField second = slopes_on(valid, random);
    const HodgeSplit of_first = fit(first);
    const HodgeSplit of_second = fit(second);
    for (std::size_t k = 0; k < first.x.size(); ++k) {
      first.x[k] = 2.0F * first.x[k] - second.x[k];
      first.y[k] = 2.0F * first.y[k] - second.y[k];
    }
    const HodgeSplit& of_both = fit(first);
    for (std::size_t k = 0; k < first.x.size(); ++k) {
      // Each of the three is exact to 1e-5 of slopes of up to 3.
      EXPECT_NEAR(of_both.curl_free_x[k], 2.0F * of_first.curl_free_x[k] - of_second.curl_free_x[k],
                  1e-4F);
      // Phases add up over 30 pitches.
      EXPECT_NEAR(of_both.phase[k], 2.0F * of_first.phase[k] - of_second.phase[k], 1e-3F);
    }
  }
}

TEST(SplitSolvers, GiveEveryPartAPhaseOfMeanZero) {
  std::mt19937 random(7105);
  for (const double faded : {0.02, 0.1, 0.5, 0.8}) {
    const Mask pupil = round_pupil(24);
    Fit fit(pupil);
    const SlopeField slopes = slopes_on(knock_out(pupil, faded, random), random);
    const HodgeSplit& split = fit(slopes);
    Lattice lattice(24, 24);
    lattice.build(slopes.valid);
    std::vector<double> sum(static_cast<std::size_t>(lattice.n_phase_groups()), 0.0);
    for (int k = 0; k < 24 * 24; ++k)
      if (lattice.phase_group_of(k) >= 0)
        sum[static_cast<std::size_t>(lattice.phase_group_of(k))] +=
            to_double(split.phase[static_cast<std::size_t>(k)]);
    // 450 phases of up to 10 rad are added in float, so that the mean is good to 2e-5.
    for (const double of_part : sum) EXPECT_NEAR(of_part, 0.0, 9e-3);
  }
}

/// The holes of the frame by the whole lattice, and their circulation by the definition.
TEST(SplitSolvers, FindTheHolesThatLensletsLeave) {
  std::mt19937 random(7106);
  int holes = 0;
  for (int trial = 0; trial < 60; ++trial) {
    SCOPED_TRACE("trial " + std::to_string(trial));
    const Mask pupil =
        trial % 2 == 0 ? annular_pupil(16, 0.3) : knock_out(square_pupil(14), 0.1, random);
    Fit fit(pupil);
    const SlopeField slopes = slopes_on(knock_out(pupil, 0.01 * trial, random), random);
    const HodgeSplit& split = fit(slopes);
    Lattice lattice(pupil.rows(), pupil.cols());
    lattice.build(slopes.valid);
    std::vector<double> loops(lattice.holes().size(), 0.0);
    for (int k = 0; k < pupil.rows() * pupil.cols(); ++k) {
      const auto i = static_cast<std::size_t>(k);
      const double x = to_double(slopes.x[i]);
      const double y = to_double(slopes.y[i]);
      const double along[4] = {y - x, -x - y, x + y, x - y};
      for (std::size_t c = 0; c < 4; ++c) {
        const int hole = lattice.hole_of_face(lattice.face_of(lattice.corners_of(k)[c]));
        if (hole >= 0 && slopes.valid[i] != 0) loops[static_cast<std::size_t>(hole)] += along[c];
      }
    }
    ASSERT_EQ(split.holes.size(), lattice.holes().size());
    for (std::size_t h = 0; h < loops.size(); ++h) {
      const LatticeHole& hole = lattice.holes()[h];
      const bool one_sublattice = hole.loops_even == 0 || hole.loops_odd == 0;
      EXPECT_EQ(split.holes[h].one_sublattice, one_sublattice);
      EXPECT_NEAR(split.holes[h].x, hole.x, 1e-4F);
      EXPECT_NEAR(split.holes[h].y, hole.y, 1e-4F);
      EXPECT_NEAR(to_double(split.holes[h].circulation), (one_sublattice ? 1.0 : 0.5) * loops[h],
                  1e-4);
      ++holes;
    }
  }
  EXPECT_GT(holes, 200);
}

/// Returns the slopes of a charge at (x0, y0): differences of its angle along the lenslets' edges.
SlopeField charge_at(const Mask& valid, double x0, double y0) {
  SlopeField slopes(valid.rows(), valid.cols());
  slopes.valid = valid;
  const auto angle = [&](double x, double y) { return std::atan2(y - y0, x - x0); };
  const auto turn = [](double to, double from) { return std::remainder(to - from, 2 * M_PI); };
  for (int r = 0; r < valid.rows(); ++r) {
    for (int c = 0; c < valid.cols(); ++c) {
      if (valid(r, c) == 0) continue;
      const double a = turn(angle(c + 0.5, r + 0.5), angle(c - 0.5, r - 0.5));
      const double b = turn(angle(c - 0.5, r + 0.5), angle(c + 0.5, r - 0.5));
      slopes.x(r, c) = static_cast<float>(0.5 * (a - b));
      slopes.y(r, c) = static_cast<float>(0.5 * (a + b));
    }
  }
  return slopes;
}

TEST(SplitSolvers, AHoleWithLoopsOnOneSublatticeHasTheWholeCirculation) {
  // A lenslet of the rim and its inner diagonal neighbour are missing. The loops of one sublattice
  // go out to the rim, and the other sublattice's loop has all of the charge's 2π.
  const Mask pupil = pupil_from({"###.####", "####.###", "########", "########", "########"});
  const SlopeField slopes = charge_at(pupil, 4.02, 1.01);
  for (const bool faded : {false, true}) {
    Fit fit(faded ? Mask(5, 8, 1) : pupil);
    const HodgeSplit& split = fit(slopes);
    ASSERT_EQ(split.holes.size(), 1U);
    EXPECT_TRUE(split.holes[0].one_sublattice);
    EXPECT_NEAR(to_double(split.holes[0].circulation), 2 * M_PI, 1e-5);
  }
}

TEST(SplitSolvers, SayThatTheyStoppedAtTheLimit) {
  std::mt19937 random(7107);
  const Mask pupil = round_pupil(20);
  SlopeField slopes = slopes_on(pupil, random);
  spread_variance(slopes, 6.0, random);
  // A tolerance of 0 is never reached while a step still changes anything.
  Fit limited(pupil, {.weighted = true, .tolerance = 0.0, .max_iterations = 2});
  EXPECT_FALSE(limited(slopes).converged);
  EXPECT_EQ(limited.split.iterations, 2);
  Fit fit(pupil, {.weighted = true});
  EXPECT_TRUE(fit(slopes).converged);
  EXPECT_GE(fit.split.iterations, 1);
}

TEST(SplitSolvers, LeaveNothingBehindInTheWorkspace) {
  std::mt19937 random(7108);
  const Mask pupil = annular_pupil(26, 0.3);
  const SlopeField whole = slopes_on(pupil, random);
  const SlopeField few = slopes_on(knock_out(pupil, 0.01, random), random);
  const SlopeField many = slopes_on(knock_out(pupil, 0.6, random), random);
  for (const SlopeField* slopes : {&whole, &few, &many}) {
    Fit fresh(pupil);
    Fit used(pupil);
    for (const SlopeField* other : {&many, &few, &whole}) used(*other);
    const HodgeSplit& a = fresh(*slopes);
    const HodgeSplit& b = used(*slopes);
    EXPECT_TRUE(std::equal(a.phase.begin(), a.phase.end(), b.phase.begin()));
    EXPECT_TRUE(std::equal(a.solenoidal_x.begin(), a.solenoidal_x.end(), b.solenoidal_x.begin()));
    EXPECT_TRUE(std::equal(a.potential.begin(), a.potential.end(), b.potential.begin()));
  }
}

TEST(SplitSolvers, SplitOtherSlopesOfAFrameWithItsFactor) {
  std::mt19937 random(7110);
  const Mask pupil = round_pupil(26);
  for (const double faded : {0.0, 0.01, 0.3}) {
    const Mask valid = knock_out(pupil, faded, random);
    SlopeField first = slopes_on(valid, random);
    SlopeField second = slopes_on(valid, random);
    spread_variance(first, 2.0, random);
    second.variance_x = first.variance_x;
    second.variance_y = first.variance_y;
    for (const bool weighted : {false, true}) {
      Fit fit(pupil, {.weighted = weighted});
      fit(first);
      split_again(fit.plan, second, fit.workspace, fit.split);
      Fit fresh(pupil, {.weighted = weighted});
      const HodgeSplit& expected = fresh(second);
      EXPECT_TRUE(
          std::equal(expected.phase.begin(), expected.phase.end(), fit.split.phase.begin()));
      ASSERT_EQ(fit.split.holes.size(), expected.holes.size());
      for (std::size_t h = 0; h < expected.holes.size(); ++h)
        EXPECT_EQ(fit.split.holes[h].circulation, expected.holes[h].circulation);
    }
  }
}

TEST(SplitSolvers, OneLensletOfManyIsLeft) {
  for (const bool weighted : {false, true}) {
    const Mask pupil = round_pupil(30);
    Fit fit(pupil, {.weighted = weighted});
    Mask valid(30, 30, 0);
    valid(15, 11) = 1;
    std::mt19937 random(7109);
    const SlopeField slopes = slopes_on(valid, random);
    const HodgeSplit& split = fit(slopes);
    EXPECT_TRUE(split.converged);
    EXPECT_NEAR(split.curl_free_x(15, 11), slopes.x(15, 11), 1e-6F);
    EXPECT_EQ(split.phase(15, 11), 0.0F);
    EXPECT_EQ(split.holes.size(), 0U);
  }
}

}  // namespace
}  // namespace curlew
