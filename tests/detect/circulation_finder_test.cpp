#include "detect/circulation_finder.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iostream>
#include <limits>
#include <numbers>
#include <random>
#include <string>

#include "core/error.h"
#include "detect/circulation.h"
#include "tests/detect/vortex_slopes.h"

namespace curlew {
namespace {

using testing::add_vortex;
using testing::flat_field;
using testing::remove_lenslet;

constexpr Morphology kNegative{std::numbers::pi, 0.0};

VortexList vortices_of(const SlopeField& slopes, const CirculationPlan& plan) {
  CirculationMap map(slopes.rows(), slopes.cols());
  VortexList vortices(plan.capacity());
  circulate(slopes, map);
  find_circulation_vortices(plan, map, vortices);
  return vortices;
}

VortexList vortices_of(const SlopeField& slopes) {
  return vortices_of(slopes, CirculationPlan({}, slopes.valid, 256));
}

TEST(VortexFinder, OneVortexOnANode) {
  for (const bool positive : {true, false}) {
    SlopeField slopes = flat_field(16, 12);
    add_vortex(slopes, 5.5, 9.5, positive ? Morphology{} : kNegative);
    const VortexList found = vortices_of(slopes);
    ASSERT_EQ(found.size(), 1U);
    EXPECT_EQ(found[0].charge, positive ? 1 : -1);
    // The place follows by symmetry, except for the float rounding of slopes.
    EXPECT_NEAR(found[0].x, 5.5F, 1e-5F);
    EXPECT_NEAR(found[0].y, 9.5F, 1e-5F);
    EXPECT_NEAR(static_cast<double>(found[0].circulation), (positive ? 1 : -1) * 4.527887014709684,
                1e-6);
    EXPECT_EQ(found[0].significance, kMaxSignificance);
    EXPECT_EQ(found[0].flags, 0U);
    EXPECT_EQ(found[0].track, -1);
  }
}

TEST(VortexFinder, EveryEighthOfACellGivesExactlyOne) {
  const CirculationPlan plan({}, Image<std::uint8_t>(16, 16, 1), 16);
  double squares = 0.0;
  double worst = 0.0;
  int n = 0;
  for (int i = 0; i <= 8; ++i) {
    for (int j = 0; j <= 8; ++j) {
      for (const bool positive : {true, false}) {
        SCOPED_TRACE("x + " + std::to_string(i) + "/8, y + " + std::to_string(j) + "/8");
        const double x = 6.0 + i / 8.0;
        const double y = 7.0 + j / 8.0;
        SlopeField slopes = flat_field(16, 16);
        add_vortex(slopes, x, y, positive ? Morphology{} : kNegative);
        const VortexList found = vortices_of(slopes, plan);
        ASSERT_EQ(found.size(), 1U);
        EXPECT_EQ(found[0].charge, positive ? 1 : -1);
        const double error =
            std::hypot(static_cast<double>(found[0].x) - x, static_cast<double>(found[0].y) - y);
        squares += error * error;
        worst = std::max(worst, error);
        ++n;
      }
    }
  }
  const double rms = std::sqrt(squares / n);
  std::cout << "position error over eighths of a cell: rms " << rms << " w, worst " << worst
            << " w\n";
  RecordProperty("position_rms", std::to_string(rms));
  // The centroid's bias on the uniform-average kernel is .023 rms.
  EXPECT_LT(rms, 0.03);
  EXPECT_LT(worst, 0.06);
}

TEST(VortexFinder, NoisyPositionsStayCloseAndInTheCell) {
  constexpr unsigned kSeed = 99;
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> place(5.0, 10.0);
  std::normal_distribution<float> noise(0.0F, 0.1F);
  const CirculationPlan plan({}, Image<std::uint8_t>(16, 16, 1), 16);
  double squares = 0.0;
  constexpr int kTrials = 400;
  for (int trial = 0; trial < kTrials; ++trial) {
    const double x = place(random);
    const double y = place(random);
    SlopeField slopes = flat_field(16, 16, 0.01F);
    add_vortex(slopes, x, y);
    for (std::size_t k = 0; k < slopes.x.size(); ++k) {
      slopes.x[k] += noise(random);
      slopes.y[k] += noise(random);
    }
    const VortexList found = vortices_of(slopes, plan);
    ASSERT_GE(found.size(), 1U);
    const Vortex& best = *std::max_element(
        found.begin(), found.end(),
        [](const Vortex& a, const Vortex& b) { return a.significance < b.significance; });
    squares +=
        std::pow(static_cast<double>(best.x) - x, 2) + std::pow(static_cast<double>(best.y) - y, 2);
    EXPECT_NEAR(best.significance, std::abs(best.circulation) / std::sqrt(0.02F), 1e-3F);
  }
  // Trials over thousands of fields give .06 w rms. It comes from noise over 4.5 rad spread over
  // nine cells.
  EXPECT_LT(std::sqrt(squares / kTrials), 0.08);
}

TEST(VortexFinder, MirrorFlipsTheCharge) {
  SlopeField slopes = flat_field(14, 15);
  add_vortex(slopes, 4.3, 6.1, {0.4, 0.7});
  add_vortex(slopes, 9.9, 8.2, kNegative);
  SlopeField mirrored = flat_field(14, 15);
  for (int r = 0; r < 14; ++r) {
    for (int c = 0; c < 15; ++c) {
      mirrored.x(r, c) = -slopes.x(r, 14 - c);
      mirrored.y(r, c) = slopes.y(r, 14 - c);
    }
  }
  const VortexList before = vortices_of(slopes);
  const VortexList after = vortices_of(mirrored);
  ASSERT_EQ(before.size(), 2U);
  ASSERT_EQ(after.size(), 2U);
  for (const Vortex& v : before) {
    const bool matched = std::any_of(after.begin(), after.end(), [&](const Vortex& m) {
      return m.charge == -v.charge && std::abs(m.x - (14.0F - v.x)) < 1e-5F &&
             std::abs(m.y - v.y) < 1e-5F && std::abs(m.circulation + v.circulation) < 1e-5F;
    });
    EXPECT_TRUE(matched);
  }
}

TEST(VortexFinder, AQuarterTurnTurnsTheVortices) {
  constexpr int kSize = 13;
  SlopeField slopes = flat_field(kSize, kSize);
  add_vortex(slopes, 3.8, 5.3, {0.5, 2.0});
  add_vortex(slopes, 8.6, 9.2, kNegative);
  // The turn takes (x, y) to (12 − y, x).
  SlopeField turned = flat_field(kSize, kSize);
  for (int r = 0; r < kSize; ++r) {
    for (int c = 0; c < kSize; ++c) {
      turned.x(c, kSize - 1 - r) = -slopes.y(r, c);
      turned.y(c, kSize - 1 - r) = slopes.x(r, c);
    }
  }
  const VortexList before = vortices_of(slopes);
  const VortexList after = vortices_of(turned);
  ASSERT_EQ(before.size(), 2U);
  ASSERT_EQ(after.size(), 2U);
  for (const Vortex& v : before) {
    const bool matched = std::any_of(after.begin(), after.end(), [&](const Vortex& t) {
      return t.charge == v.charge && std::abs(t.x - (12.0F - v.y)) < 1e-5F &&
             std::abs(t.y - v.x) < 1e-5F && std::abs(t.circulation - v.circulation) < 1e-5F;
    });
    EXPECT_TRUE(matched);
  }
}

TEST(VortexFinder, TranslationMovesTheVortex) {
  SlopeField here = flat_field(20, 20);
  SlopeField there = flat_field(20, 20);
  add_vortex(here, 6.3, 7.9);
  add_vortex(there, 11.3, 9.9);
  const VortexList a = vortices_of(here);
  const VortexList b = vortices_of(there);
  ASSERT_EQ(a.size(), 1U);
  ASSERT_EQ(b.size(), 1U);
  EXPECT_NEAR(b[0].x - a[0].x, 5.0F, 1e-5F);
  EXPECT_NEAR(b[0].y - a[0].y, 2.0F, 1e-5F);
  EXPECT_NEAR(b[0].circulation, a[0].circulation, 1e-5F);
}

TEST(VortexFinder, DipolesOfAPitchAndMoreAreTwoVortices) {
  for (const double s : {1.0, 1.5, 2.0, 3.0}) {
    SCOPED_TRACE("separation " + std::to_string(s));
    SlopeField slopes = flat_field(16, 16);
    add_vortex(slopes, 6.5, 7.5);
    add_vortex(slopes, 6.5 + s, 7.5, kNegative);
    const VortexList found = vortices_of(slopes);
    ASSERT_EQ(found.size(), 2U);
    EXPECT_EQ(found[0].charge, 1);
    EXPECT_EQ(found[1].charge, -1);
    // Each vortex cancels some of the other's circulation between them, so that they seem further
    // apart.
    EXPECT_NEAR(found[0].x, 6.5, 0.15);
    EXPECT_NEAR(found[1].x, 6.5 + s, 0.15);
    EXPECT_NEAR(found[0].y, 7.5F, 1e-5F);
  }
}

TEST(VortexFinder, NoNoiseAndNoVortexGivesNothing) {
  EXPECT_TRUE(vortices_of(flat_field(16, 16)).empty());
  constexpr unsigned kSeed = 12;
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  std::normal_distribution<float> rounding(0.0F, 1e-6F);
  // The field says that it has no noise, but it has rounding.
  SlopeField slopes = flat_field(16, 16);
  for (std::size_t k = 0; k < slopes.x.size(); ++k) {
    slopes.x[k] = 0.3F + rounding(random);
    slopes.y[k] = -0.2F + rounding(random);
  }
  EXPECT_TRUE(vortices_of(slopes).empty());
}

TEST(VortexFinder, SignificanceIsFiniteWhateverTheVariance) {
  for (const float variance : {0.0F, 1e-38F, std::numeric_limits<float>::denorm_min(), 1e-4F}) {
    SlopeField slopes = flat_field(10, 10, variance);
    add_vortex(slopes, 4.2, 4.7);
    const VortexList found = vortices_of(slopes);
    ASSERT_EQ(found.size(), 1U);
    EXPECT_TRUE(std::isfinite(found[0].significance));
    EXPECT_LE(found[0].significance, kMaxSignificance);
    EXPECT_GT(found[0].significance, 100.0F);
    EXPECT_TRUE(std::isfinite(found[0].x) && std::isfinite(found[0].y));
  }
}

TEST(VortexFinder, BrokenNumbersAreNoVortices) {
  const CirculationPlan plan({}, Image<std::uint8_t>(8, 8, 1), 16);
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  constexpr float kInf = std::numeric_limits<float>::infinity();
  for (const auto& [value, variance] :
       {std::pair{kNan, 0.1F}, {kInf, 0.1F}, {-kInf, 0.0F}, {3.0F, kNan}, {3.0F, kInf}}) {
    CirculationMap map(8, 8);
    map.valid.fill(1);
    map.n_valid = 49;
    map.variance.fill(0.01F);
    map.value(3, 3) = value;
    map.variance(3, 3) = variance;
    VortexList vortices(16);
    find_circulation_vortices(plan, map, vortices);
    EXPECT_TRUE(vortices.empty());
  }
}

TEST(VortexFinder, PlateausAndTiesGiveOne) {
  const CirculationPlan plan({}, Image<std::uint8_t>(9, 9, 1), 64);
  CirculationMap map(9, 9);
  map.valid.fill(1);
  map.n_valid = 64;
  VortexList vortices(64);
  map.value.fill(2.0F);
  find_circulation_vortices(plan, map, vortices);
  EXPECT_EQ(vortices.size(), 1U);

  // A vortex on a lenslet's centre makes four equal cells.
  map.value.fill(0.0F);
  for (const auto& [r, c] : {std::pair{3, 3}, {3, 4}, {4, 3}, {4, 4}}) map.value(r, c) = -1.5F;
  find_circulation_vortices(plan, map, vortices);
  ASSERT_EQ(vortices.size(), 1U);
  EXPECT_EQ(vortices[0].charge, -1);
  EXPECT_FLOAT_EQ(vortices[0].x, 4.0F);
  EXPECT_FLOAT_EQ(vortices[0].y, 4.0F);
}

TEST(VortexFinder, AnInsignificantNeighbourDoesNotSuppress) {
  const CirculationPlan plan({}, Image<std::uint8_t>(9, 9, 1), 64);
  CirculationMap map(9, 9);
  map.valid.fill(1);
  map.n_valid = 64;
  map.variance.fill(0.01F);
  map.value(4, 4) = 2.0F;
  map.value(4, 5) = 3.0F;
  map.variance(4, 5) = 25.0F;  // A nearly dark lenslet has as much.
  VortexList vortices(64);
  find_circulation_vortices(plan, map, vortices);
  ASSERT_EQ(vortices.size(), 1U);
  EXPECT_EQ(vortices[0].circulation, 2.0F);
  EXPECT_NEAR(vortices[0].x, 4.5F, 1e-6F);  // The position is not pulled either.
}

TEST(VortexFinder, LobesAreNotVorticesAndWeakPartnersAre) {
  const CirculationPlan plan({}, Image<std::uint8_t>(9, 9, 1), 64);
  CirculationMap map(9, 9);
  map.valid.fill(1);
  map.n_valid = 64;
  VortexList vortices(64);
  map.value(4, 4) = 4.0F;
  map.value(5, 5) = -0.15F * 4.0F + 0.01F;
  find_circulation_vortices(plan, map, vortices);
  EXPECT_EQ(vortices.size(), 1U);
  map.value(5, 5) = -0.15F * 4.0F - 0.01F;
  find_circulation_vortices(plan, map, vortices);
  EXPECT_EQ(vortices.size(), 2U);
}

TEST(VortexFinder, ThresholdFollowsTheFrame) {
  const CirculationPlan plan({}, Image<std::uint8_t>(16, 16, 1), 64);
  EXPECT_EQ(plan.n_cells(), 225);
  // 15×15 cells have 2·15·14 orthogonal and 2·14·14 diagonal pairs, which are seen from both ends.
  const CellNeighbours neighbours{4.0 * 15 * 14 / 225, 4.0 * 14 * 14 / 225};
  for (const int n : {1, 2, 9, 57, 143, 224, 225}) {
    // The thresholds are linear between knots 5 % apart in n.
    EXPECT_NEAR(static_cast<double>(plan.threshold_sigmas(n)),
                threshold_sigmas(0.01, n, neighbours), 1e-4);
  }
  const double z = static_cast<double>(plan.threshold_sigmas(225));
  for (const double excess : {0.999, 1.001}) {
    CirculationMap map(16, 16);
    map.valid.fill(1);
    map.n_valid = 225;
    map.variance.fill(0.09F);
    map.value(7, 7) = static_cast<float>(0.3 * z * excess);
    VortexList vortices(8);
    find_circulation_vortices(plan, map, vortices);
    EXPECT_EQ(vortices.size(), excess > 1.0 ? 1U : 0U);
  }
}

TEST(VortexFinder, FlagsAtTheEdge) {
  struct Case {
    double x, y;
    std::uint32_t flags;
  };
  for (const Case& c : {Case{0.5, 5.5, kVortexAtPupilEdge},
                        {8.5, 5.5, kVortexAtPupilEdge},
                        {5.5, 0.5, kVortexAtPupilEdge},
                        {5.5, 8.5, kVortexAtPupilEdge},
                        {1.5, 1.5, 0},
                        {7.5, 7.5, 0}}) {
    SlopeField slopes = flat_field(10, 10);
    add_vortex(slopes, c.x, c.y);
    const VortexList found = vortices_of(slopes);
    ASSERT_EQ(found.size(), 1U) << c.x << " " << c.y;
    EXPECT_EQ(found[0].flags, c.flags) << c.x << " " << c.y;
    EXPECT_LE(std::abs(static_cast<double>(found[0].x) - c.x), 0.5);
    EXPECT_LE(std::abs(static_cast<double>(found[0].y) - c.y), 0.5);
  }
}

TEST(VortexFinder, FlagsAtHolesFadesAndNotches) {
  const auto flags_beside = [](int hole_row, int hole_col, bool in_plan, double x, double y) {
    SlopeField slopes = flat_field(12, 12);
    const Image<std::uint8_t> full = slopes.valid;
    add_vortex(slopes, x, y);
    remove_lenslet(slopes, hole_row, hole_col);
    const CirculationPlan plan({}, in_plan ? slopes.valid : full, 16);
    const VortexList found = vortices_of(slopes, plan);
    EXPECT_GE(found.size(), 1U);
    return found.empty() ? 0U : found[0].flags;
  };
  // Lenslet (5, 6) is a hole of the sensor, or it fades in this frame. The vortex is a cell away.
  EXPECT_EQ(flags_beside(5, 6, true, 4.5, 5.5), std::uint32_t{kVortexAtHole});
  EXPECT_EQ(flags_beside(5, 6, false, 4.5, 5.5), std::uint32_t{kVortexAtHole});
  EXPECT_EQ(flags_beside(5, 6, true, 2.5, 5.5), 0U);
  // A missing lenslet of the rim is a notch in the pupil, a faded one is not.
  EXPECT_EQ(flags_beside(0, 6, true, 6.5, 1.5), std::uint32_t{kVortexAtPupilEdge});
  EXPECT_EQ(flags_beside(0, 6, false, 6.5, 1.5), std::uint32_t{kVortexAtHole});
  // This vortex lies at the edge and at a hole.
  EXPECT_EQ(flags_beside(2, 6, true, 6.5, 0.5), kVortexAtPupilEdge | kVortexAtHole);
}

TEST(VortexFinder, OverflowIsCounted) {
  SlopeField slopes = flat_field(30, 30);
  for (const double x : {4.5, 14.5, 24.5}) {
    for (const double y : {4.5, 14.5, 24.5}) add_vortex(slopes, x, y);
  }
  const VortexList all = vortices_of(slopes);
  ASSERT_EQ(all.size(), 9U);
  EXPECT_EQ(all.overflow(), 0);
  const VortexList few = vortices_of(slopes, CirculationPlan({}, slopes.valid, 2));
  EXPECT_EQ(few.size(), 2U);
  EXPECT_EQ(few.overflow(), 7);
  const VortexList none = vortices_of(slopes, CirculationPlan({}, slopes.valid, 0));
  EXPECT_EQ(none.size(), 0U);
  EXPECT_EQ(none.overflow(), 9);
}

TEST(VortexFinder, RandomFieldsAndMasks) {
  for (unsigned seed = 1; seed <= 60; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    std::mt19937 random(seed);
    std::uniform_int_distribution<int> size(2, 70);
    std::uniform_real_distribution<double> unit(0.0, 1.0);
    std::normal_distribution<float> noise(0.0F, 1.0F);
    const int rows = size(random);
    const int cols = size(random);
    SlopeField slopes = flat_field(rows, cols, seed % 3 == 0 ? 0.0F : 0.04F);
    for (std::size_t k = 0; k < slopes.x.size(); ++k) {
      slopes.x[k] = noise(random);
      slopes.y[k] = noise(random);
    }
    for (int k = 0; k < rows * cols / 20; ++k) {
      remove_lenslet(slopes, static_cast<int>(unit(random) * rows),
                     static_cast<int>(unit(random) * cols));
    }
    CirculationOptions options;
    // A rate of 1e9 makes no threshold at all.
    options.false_alarms_per_frame = seed % 5 == 0 ? 1e9 : 0.5;
    const CirculationPlan plan(options, slopes.valid, 4096);
    for (int k = 0; k < rows * cols / 30; ++k) {
      remove_lenslet(slopes, static_cast<int>(unit(random) * rows),
                     static_cast<int>(unit(random) * cols));
    }
    CirculationMap map(rows, cols);
    VortexList found(plan.capacity());
    circulate(slopes, map);
    find_circulation_vortices(plan, map, found);
    const float z = plan.threshold_sigmas(map.n_valid);
    for (const Vortex& v : found) {
      // The vortex's own cell is the one near it that has exactly its circulation.
      bool own = false;
      for (int r = 0; r < map.value.rows(); ++r) {
        for (int c = 0; c < map.value.cols(); ++c) {
          own |= map.valid(r, c) != 0 && map.value(r, c) == v.circulation &&
                 std::abs(v.x - static_cast<float>(c) - 0.5F) <= 1.0F &&
                 std::abs(v.y - static_cast<float>(r) - 0.5F) <= 1.0F;
        }
      }
      ASSERT_TRUE(own);
      ASSERT_TRUE(std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.significance));
      ASSERT_GE(v.significance, z);
      ASSERT_EQ(v.charge, v.circulation > 0.0F ? 1 : -1);
      ASSERT_EQ(v.flags & ~std::uint32_t{kVortexAtPupilEdge | kVortexAtHole}, 0U);
    }
  }
}

TEST(VortexFinder, NoCellsNoVortices) {
  SlopeField slopes(8, 8);
  const CirculationPlan plan({}, slopes.valid, 8);
  EXPECT_EQ(plan.n_cells(), 0);
  EXPECT_TRUE(vortices_of(slopes, plan).empty());
}

TEST(CirculationPlan, RefusesNonsense) {
  const Image<std::uint8_t> mask(4, 4, 1);
  for (const double rate : {0.0, -1.0, std::numeric_limits<double>::quiet_NaN(),
                            std::numeric_limits<double>::infinity()}) {
    CirculationOptions options;
    options.false_alarms_per_frame = rate;
    EXPECT_THROW(CirculationPlan(options, mask, 8), UsageError) << rate;
  }
  CirculationOptions no_floor;
  no_floor.min_circulation_rad = 0.0;
  EXPECT_THROW(CirculationPlan(no_floor, mask, 8), UsageError);
  CirculationOptions all_lobes;
  all_lobes.lobe_fraction = 1.0;
  EXPECT_THROW(CirculationPlan(all_lobes, mask, 8), UsageError);
  EXPECT_THROW(CirculationPlan({}, Image<std::uint8_t>(1, 9, 1), 8), Failure);
}

}  // namespace
}  // namespace curlew
