#include "reconstruct/branch_cuts.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "reconstruct/vortex_field.h"

namespace curlew {
namespace {

constexpr float kPi = std::numbers::pi_v<float>;

Image<float> wrapped_phase(int n, const std::vector<PointVortex>& vortices) {
  Image<float> phase(n, n), x(n, n), y(n, n);
  evaluate_vortices(vortices.data(), vortices.size(), 0.2F, phase, x, y);
  return phase;
}

struct Unwrapped {
  Unwrapped(const Image<float>& wrapped, const Image<float>& flux, const Image<std::uint8_t>& valid,
            std::size_t capacity = 32)
      : workspace(wrapped.rows(), wrapped.cols(), capacity), phase(wrapped.rows(), wrapped.cols()) {
    unwrap_with_cuts(wrapped, flux, valid, workspace, phase);
  }
  BranchCutWorkspace workspace;
  Image<float> phase;
};

/// Expects that jumps over π between neighbours are at cuts and nowhere else, and that the phase is
/// the wrapped one except for whole turns.
void expect_torn_at_cuts_only(const Image<float>& wrapped, const Unwrapped& unwrapped) {
  const int cols = wrapped.cols();
  Image<std::uint8_t> cut_right(wrapped.rows(), cols), cut_down(wrapped.rows(), cols);
  for (const CutEdge& cut : unwrapped.workspace.cuts) {
    const auto from = static_cast<std::size_t>(cut.from);
    (cut.to == cut.from + 1 ? cut_right : cut_down)[from] = 1;
    const float jump = unwrapped.phase[static_cast<std::size_t>(cut.to)] - unwrapped.phase[from];
    EXPECT_NEAR(jump, 2.0F * kPi * static_cast<float>(cut.turns), kPi + 1e-3F);
    EXPECT_NE(cut.turns, 0);
  }
  for (int r = 0; r < wrapped.rows(); ++r) {
    for (int c = 0; c < cols; ++c) {
      const float turns = (unwrapped.phase(r, c) - wrapped(r, c)) / (2.0F * kPi);
      EXPECT_NEAR(turns, std::round(turns), 1e-4F);
      if (c + 1 < cols && cut_right(r, c) == 0) {
        EXPECT_LE(std::abs(unwrapped.phase(r, c + 1) - unwrapped.phase(r, c)), kPi + 1e-3F);
      }
      if (r + 1 < wrapped.rows() && cut_down(r, c) == 0) {
        EXPECT_LE(std::abs(unwrapped.phase(r + 1, c) - unwrapped.phase(r, c)), kPi + 1e-3F);
      }
    }
  }
}

TEST(VortexField, IsTheSumOfArguments) {
  std::mt19937 random(1);
  std::uniform_real_distribution<float> place(-1.0F, 18.0F);
  std::vector<PointVortex> vortices;
  for (int i = 0; i < 40; ++i)
    vortices.push_back({place(random), place(random), i % 3 ? 1.F : -1.F});
  Image<float> phase(17, 19), x(17, 19), y(17, 19);
  evaluate_vortices(vortices.data(), vortices.size(), 0.2F, phase, x, y);
  for (int r = 0; r < 17; ++r) {
    for (int c = 0; c < 19; ++c) {
      double sum = 0.0, sx = 0.0, sy = 0.0;
      for (const PointVortex& v : vortices) {
        const double dx = static_cast<double>(c) - static_cast<double>(v.x);
        const double dy = static_cast<double>(r) - static_cast<double>(v.y);
        const double q = static_cast<double>(v.charge);
        sum += q * std::atan2(dy, dx);
        sx -= q * dy / (dx * dx + dy * dy + 0.2);
        sy += q * dx / (dx * dx + dy * dy + 0.2);
      }
      // The arctangent's polynomial errs by 1.2e-5, and the 40 products in float by the rest.
      EXPECT_NEAR(std::remainder(static_cast<double>(phase(r, c)) - sum, 2.0 * std::numbers::pi),
                  0.0, 3e-5);
      EXPECT_NEAR(static_cast<double>(x(r, c)), sx, 2e-5);
      EXPECT_NEAR(static_cast<double>(y(r, c)), sy, 2e-5);
    }
  }
}

TEST(BranchCuts, EveryLoopButThoseOfVorticesAddsUpToNothing) {
  const int n = 20;
  std::mt19937 random(2);
  std::uniform_real_distribution<float> place(1.0F, 18.0F);
  std::exponential_distribution<float> light(0.01F);
  for (int trial = 0; trial < 20; ++trial) {
    std::vector<PointVortex> vortices;
    for (int i = 0; i < 9; ++i)
      vortices.push_back({place(random), place(random), i % 2 == 0 ? 1.0F : -1.0F});
    Image<float> flux(n, n);
    for (float& f : flux) f = light(random);
    const Image<float> wrapped = wrapped_phase(n, vortices);
    const Unwrapped unwrapped(wrapped, flux, Image<std::uint8_t>(n, n, 1));
    int charge = 0;
    for (const auto& residue : unwrapped.workspace.residues) charge += residue.charge;
    EXPECT_EQ(charge, 1) << "trial " << trial;  // All nine lie inside.
    EXPECT_FALSE(unwrapped.workspace.cuts.empty());
    expect_torn_at_cuts_only(wrapped, unwrapped);
  }
}

TEST(BranchCuts, RunThroughTheDark) {
  // A dark trench in the shape of a U joins two opposite vortices. The light on the straight way
  // between them is bright.
  const int n = 15;
  Image<float> flux(n, n, 100.0F);
  for (int r = 4; r <= 11; ++r)
    for (const int c : {3, 4, 10, 11}) flux(r, c) = 0.0F;
  for (int c = 3; c <= 11; ++c) flux(10, c) = flux(11, c) = 0.0F;
  const std::vector<PointVortex> pair{{3.5F, 4.5F, 1.0F}, {10.5F, 4.5F, -1.0F}};
  const Image<float> wrapped = wrapped_phase(n, pair);
  const Image<std::uint8_t> valid(n, n, 1);
  const Unwrapped dark(wrapped, flux, valid);
  ASSERT_EQ(dark.workspace.residues.size(), 2U);
  EXPECT_EQ(dark.workspace.light_cut, 0.0);
  EXPECT_EQ(dark.workspace.cuts.size(), 6U + 7U + 6U);  // The cut goes down, across and up.
  expect_torn_at_cuts_only(wrapped, dark);
  // In even light the cut goes straight.
  const Unwrapped even(wrapped, Image<float>(n, n, 100.0F), valid);
  EXPECT_EQ(even.workspace.cuts.size(), 7U);
  EXPECT_EQ(even.workspace.light_cut, 1400.0);
}

TEST(BranchCuts, EndAtThePupilsEdgeWhereThatIsNearer) {
  const int n = 20;
  Image<std::uint8_t> valid(n, n, 1);
  for (int r = 0; r < n; ++r) valid(r, 0) = valid(r, 1) = valid(r, 2) = 0;
  const Image<float> flux(n, n, 100.0F);
  // There is one turn, far from the array's edge and near the pupil's edge.
  const Image<float> one = wrapped_phase(n, {{4.5F, 10.5F, 1.0F}});
  const Unwrapped single(one, flux, valid);
  ASSERT_EQ(single.workspace.residues.size(), 1U);
  EXPECT_EQ(single.workspace.light_cut, 400.0);  // It cuts columns 4 and 3 of two rows.
  expect_torn_at_cuts_only(one, single);
  // Opposite vortices far from each other are each joined with the edge near it. Near each other
  // they are joined.
  const Image<float> far = wrapped_phase(n, {{4.5F, 10.5F, 1.0F}, {17.5F, 10.5F, -1.0F}});
  const Unwrapped apart(far, flux, valid);
  EXPECT_EQ(apart.workspace.light_cut, 400.0 + 400.0);
  const Image<float> near = wrapped_phase(n, {{9.5F, 10.5F, 1.0F}, {11.5F, 10.5F, -1.0F}});
  const Unwrapped joined(near, flux, valid);
  EXPECT_EQ(joined.workspace.cuts.size(), 2U);
}

TEST(BranchCuts, PairsAreThoseOfTheLeastSum) {
  // Vortices of + − + − lie in a row, with the middle gap the narrowest. If it were joined first,
  // all cuts together would cost more.
  const int n = 40;
  const std::vector<PointVortex> row{
      {9.5F, 20.5F, 1.0F}, {14.5F, 20.5F, -1.0F}, {18.5F, 20.5F, 1.0F}, {23.5F, 20.5F, -1.0F}};
  const Unwrapped unwrapped(wrapped_phase(n, row), Image<float>(n, n, 1.0F),
                            Image<std::uint8_t>(n, n, 1));
  ASSERT_EQ(unwrapped.workspace.residues.size(), 4U);
  EXPECT_EQ(unwrapped.workspace.cuts.size(), 10U);
}

TEST(BranchCuts, MoreResiduesThanFitAreCounted) {
  const int n = 20;
  std::vector<PointVortex> vortices;
  for (int i = 0; i < 6; ++i)
    vortices.push_back({2.5F + 3.0F * static_cast<float>(i), 9.5F, i % 2 == 0 ? 1.0F : -1.0F});
  const Unwrapped unwrapped(wrapped_phase(n, vortices), Image<float>(n, n, 1.0F),
                            Image<std::uint8_t>(n, n, 1), 2);
  EXPECT_EQ(unwrapped.workspace.residues.size(), 2U);
  EXPECT_EQ(unwrapped.workspace.residues.overflow(), 4);
  for (const float phase : unwrapped.phase) EXPECT_TRUE(std::isfinite(phase));
}

}  // namespace
}  // namespace curlew
