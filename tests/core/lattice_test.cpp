#include "core/lattice.h"

#include <gtest/gtest.h>

#include <random>

#include "tests/support/pupils.h"

namespace curlew {
namespace {

using testing::annular_pupil;
using testing::knock_out;
using testing::Mask;
using testing::pupil_from;
using testing::square_pupil;

Lattice lattice_of(const Mask& mask) {
  Lattice lattice(mask.rows(), mask.cols());
  lattice.build(mask);
  return lattice;
}

int loops(const Lattice& lattice) {
  int n = 0;
  for (const LatticeHole& hole : lattice.holes()) n += hole.loops_even + hole.loops_odd;
  return n;
}

Mask without(Mask mask, std::initializer_list<std::pair<int, int>> missing) {
  for (const auto& [r, c] : missing) mask(r, c) = 0;
  return mask;
}

// One missing lenslet, or a compact block of them, is a hole with two loops, one on each
// sublattice. Two that touch by a corner share one hole with three loops. A gap in the rim has
// none, and a missing lenslet that touches such a gap by a corner has one loop only.
TEST(Lattice, LoopsOfHoles) {
  const Mask full = square_pupil(9);
  EXPECT_EQ(loops(lattice_of(full)), 0);
  EXPECT_EQ(loops(lattice_of(without(full, {{4, 4}}))), 2);
  EXPECT_EQ(loops(lattice_of(without(full, {{4, 4}, {4, 5}}))), 2);
  EXPECT_EQ(loops(lattice_of(without(full, {{4, 4}, {4, 5}, {5, 4}, {5, 5}}))), 2);
  Mask three = full;
  for (int r = 3; r < 6; ++r)
    for (int c = 3; c < 6; ++c) three(r, c) = 0;
  EXPECT_EQ(loops(lattice_of(three)), 2);
  EXPECT_EQ(loops(lattice_of(without(full, {{4, 4}, {5, 5}}))), 3);
  EXPECT_EQ(loops(lattice_of(without(full, {{0, 4}}))), 0);
  EXPECT_EQ(loops(lattice_of(without(full, {{0, 4}, {1, 5}}))), 1);
}

TEST(Lattice, HolesThatTouchAreOneAndARimHoleIsHalf) {
  const Mask full = square_pupil(9);
  const Lattice touching = lattice_of(without(full, {{4, 4}, {5, 5}}));
  ASSERT_EQ(touching.holes().size(), 1U);
  EXPECT_EQ(touching.holes()[0].loops_even + touching.holes()[0].loops_odd, 3);
  const Lattice rim = lattice_of(without(full, {{0, 4}, {1, 5}}));
  ASSERT_EQ(rim.holes().size(), 1U);
  EXPECT_TRUE(rim.holes()[0].loops_even == 0 || rim.holes()[0].loops_odd == 0);
  const Lattice apart = lattice_of(without(full, {{2, 2}, {6, 6}}));
  EXPECT_EQ(apart.holes().size(), 2U);
}

/// Counts loops by Euler's formula: edges − nodes + components − cells.
int loops_by_euler(const Mask& mask, const Lattice& lattice) {
  int cells = 0;
  for (int r = 0; r + 1 < mask.rows(); ++r)
    for (int c = 0; c + 1 < mask.cols(); ++c)
      cells +=
          mask(r, c) != 0 && mask(r, c + 1) != 0 && mask(r + 1, c) != 0 && mask(r + 1, c + 1) != 0;
  return 2 * lattice.n_lenslets() - lattice.n_nodes() + lattice.n_components() - cells;
}

TEST(Lattice, EulersFormulaOnRandomPupils) {
  std::mt19937 random(7101);
  SCOPED_TRACE("seed 7101");
  for (int trial = 0; trial < 300; ++trial) {
    const Mask mask =
        knock_out(trial % 2 == 0 ? square_pupil(4 + trial % 9) : annular_pupil(6 + trial % 9, 0.3),
                  0.05 * (trial % 13), random);
    const Lattice lattice = lattice_of(mask);
    EXPECT_EQ(loops(lattice), loops_by_euler(mask, lattice)) << "trial " << trial;
  }
}

TEST(Lattice, ComponentsAndPhaseGroups) {
  EXPECT_EQ(lattice_of(pupil_from({"#"})).n_components(), 2);
  EXPECT_EQ(lattice_of(square_pupil(5)).n_components(), 2);
  // Lenslets apart share no component. Lenslets that touch by a side share both sublattices, and
  // those that touch by a corner share one.
  EXPECT_EQ(lattice_of(pupil_from({"#.#"})).n_components(), 4);
  EXPECT_EQ(lattice_of(pupil_from({"##"})).n_components(), 2);
  const Lattice corner = lattice_of(pupil_from({"#.", ".#"}));
  EXPECT_EQ(corner.n_components(), 3);
  EXPECT_EQ(corner.n_phase_groups(), 2);
  EXPECT_NE(corner.phase_group_of(0), corner.phase_group_of(3));
  EXPECT_EQ(corner.phase_group_of(1), -1);
  EXPECT_EQ(lattice_of(square_pupil(5)).n_phase_groups(), 1);
}

}  // namespace
}  // namespace curlew
