// These tests give the interpretable detector slopes whose vortices are known.
#include "detect/whitened/whitened_finder.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <utility>
#include <vector>

#include "core/error.h"
#include "detect/circulation.h"
#include "detect/false_alarm_control.h"
#include "tests/detect/vortex_slopes.h"

namespace curlew {
namespace {

using testing::add_vortex;
using testing::flat_field;
using testing::remove_lenslet;

constexpr int kSize = 16;

struct Found {
  std::vector<Vortex> vortices;
  const Vortex& only() const { return vortices.front(); }
};

Found find(const SlopeField& slopes, const Image<float>& flux, WhitenedOptions options = {}) {
  const Image<std::uint8_t> lenslets(slopes.rows(), slopes.cols(), 1);
  const WhitenedPlan plan(options, lenslets, 64);
  WhitenedWorkspace workspace(plan);
  CirculationMap map(slopes.rows(), slopes.cols());
  circulate(slopes, map);
  VortexList vortices(plan.capacity());
  find_whitened_vortices(plan, slopes, flux, map, workspace, vortices);
  EXPECT_EQ(vortices.overflow(), 0);
  return {{vortices.begin(), vortices.end()}};
}

Image<float> even_flux() { return Image<float>(kSize, kSize, 1000.0F); }

void add_conjugate_vortex(SlopeField& slopes, double x, double y) {
  SlopeField other = flat_field(slopes.rows(), slopes.cols());
  add_vortex(other, x, y);
  for (std::size_t k = 0; k < slopes.x.size(); ++k) {
    slopes.x[k] -= other.x[k];
    slopes.y[k] -= other.y[k];
  }
}

TEST(WhitenedFinder, FindsAVortexAtAnyPlaceWithinANode) {
  for (const double dx : {-0.4, -0.2, 0.0, 0.3}) {
    for (const double dy : {-0.3, 0.0, 0.45}) {
      SCOPED_TRACE(::testing::Message() << dx << ", " << dy);
      SlopeField slopes = flat_field(kSize, kSize, 0.01F);
      add_vortex(slopes, 7.5 + dx, 6.5 + dy);
      const Found found = find(slopes, even_flux());
      ASSERT_EQ(found.vortices.size(), 1U);
      const Vortex& vortex = found.only();
      EXPECT_EQ(vortex.charge, 1);
      // The position goes only part of the way to the centroid, because that is best on propagated
      // fields.
      EXPECT_NEAR(vortex.x, 7.5 + dx, 0.25);
      EXPECT_NEAR(vortex.y, 6.5 + dy, 0.25);
      EXPECT_GT(vortex.probability, 0.8F);
      EXPECT_GT(vortex.variance_x, 0.0F);
      EXPECT_GT(vortex.significance, 10.0F);
      EXPECT_EQ(vortex.flags, 0U);
    }
  }
}

TEST(WhitenedFinder, FollowsTheDarknessWhereCirculationIsEven) {
  SlopeField slopes = flat_field(kSize, kSize, 0.01F);
  add_vortex(slopes, 7.5, 7.5);
  Image<float> flux = even_flux();
  flux(7, 8) = flux(8, 8) = 100.0F;  // They are the right pair of the node's four.
  const Found found = find(slopes, flux);
  ASSERT_EQ(found.vortices.size(), 1U);
  EXPECT_GT(found.only().x, 7.6F);
  EXPECT_NEAR(found.only().y, 7.5F, 0.05F);
}

TEST(WhitenedFinder, NeedsNoNoise) {
  SlopeField slopes = flat_field(kSize, kSize, 0.0F);
  add_vortex(slopes, 5.4, 9.7);
  const Found found = find(slopes, even_flux());
  ASSERT_EQ(found.vortices.size(), 1U);
  EXPECT_EQ(found.only().significance, kMaxSignificance);
}

TEST(WhitenedFinder, FindsNothingWhereThereIsNothing) {
  EXPECT_TRUE(find(flat_field(kSize, kSize, 0.0F), even_flux()).vortices.empty());
  EXPECT_TRUE(find(flat_field(kSize, kSize, 0.01F), Image<float>(kSize, kSize)).vortices.empty());
  SlopeField none(kSize, kSize);
  EXPECT_TRUE(find(none, even_flux()).vortices.empty());
}

/// This is a field of vortices and noise, uneven in flux.
struct WhitenedScene {
  SlopeField slopes = flat_field(kSize, kSize, 0.02F);
  Image<float> flux = even_flux();
};

WhitenedScene random_scene(unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> place(2.0, 13.0);
  WhitenedScene scene;
  for (int i = 0; i < 3; ++i) {
    add_vortex(scene.slopes, place(random), place(random));
    add_conjugate_vortex(scene.slopes, place(random), place(random));
  }
  for (std::size_t k = 0; k < scene.flux.size(); ++k) {
    scene.slopes.x[k] += static_cast<float>(0.14 * normal(random));
    scene.slopes.y[k] += static_cast<float>(0.14 * normal(random));
    scene.flux[k] *= static_cast<float>(std::exp(0.5 * normal(random)));
  }
  return scene;
}

template <typename Place>
WhitenedScene turned(const WhitenedScene& scene, float along_x, float along_y, bool swapped,
                     Place place) {
  WhitenedScene out = scene;
  for (int r = 0; r < kSize; ++r) {
    for (int c = 0; c < kSize; ++c) {
      const auto [row, col] = place(r, c);
      const float x = scene.slopes.x(r, c);
      const float y = scene.slopes.y(r, c);
      out.slopes.x(row, col) = along_x * (swapped ? y : x);
      out.slopes.y(row, col) = along_y * (swapped ? x : y);
      out.flux(row, col) = scene.flux(r, c);
    }
  }
  return out;
}

TEST(WhitenedFinder, MirroringAndTransposingTurnChargesOver) {
  int seen = 0;
  for (unsigned seed = 1; seed <= 5; ++seed) {
    SCOPED_TRACE(::testing::Message() << "seed " << seed);
    const WhitenedScene scene = random_scene(seed);
    const Found found = find(scene.slopes, scene.flux);
    const WhitenedScene mirror = turned(scene, -1.0F, 1.0F, false, [](int r, int c) {
      return std::pair{r, kSize - 1 - c};
    });
    const WhitenedScene transpose = turned(scene, 1.0F, 1.0F, true, [](int r, int c) {
      return std::pair{c, r};
    });
    const Found mirrored = find(mirror.slopes, mirror.flux);
    const Found transposed = find(transpose.slopes, transpose.flux);
    ASSERT_EQ(mirrored.vortices.size(), found.vortices.size());
    ASSERT_EQ(transposed.vortices.size(), found.vortices.size());
    for (std::size_t i = 0; i < found.vortices.size(); ++i) {
      const Vortex& a = found.vortices[i];
      EXPECT_EQ(mirrored.vortices[i].charge, -a.charge);
      EXPECT_NEAR(mirrored.vortices[i].x, kSize - 1 - a.x, 1e-3F);
      EXPECT_NEAR(mirrored.vortices[i].y, a.y, 1e-3F);
      EXPECT_EQ(transposed.vortices[i].charge, -a.charge);
      EXPECT_NEAR(transposed.vortices[i].x, a.y, 1e-3F);
      EXPECT_NEAR(transposed.vortices[i].y, a.x, 1e-3F);
      EXPECT_NEAR(transposed.vortices[i].probability, a.probability, 1e-3F);
      ++seen;
    }
  }
  EXPECT_GE(seen, 10);
}

TEST(WhitenedFinder, AClosePairIsOneUnresolvedPair) {
  SlopeField slopes = flat_field(kSize, kSize, 0.01F);
  add_vortex(slopes, 7.75, 7.5);
  add_conjugate_vortex(slopes, 8.25, 7.5);
  WhitenedOptions options;
  options.min_probability = 0.01;
  const Found found = find(slopes, even_flux(), options);
  ASSERT_EQ(found.vortices.size(), 1U);
  const Vortex& pair = found.only();
  EXPECT_EQ(pair.charge, 0);
  EXPECT_NE(pair.flags & kVortexUnresolvedPair, 0U);
  EXPECT_NEAR(pair.x, 8.0F, 0.1F);
  EXPECT_NEAR(pair.y, 7.5F, 0.1F);
  EXPECT_NEAR(pair.circulation, 0.0F, 0.1F);

  options.pair_sigmas = 0.0;
  EXPECT_EQ(find(slopes, even_flux(), options).vortices.size(), 2U);
}

TEST(WhitenedFinder, AWidePairIsTwoVortices) {
  SlopeField slopes = flat_field(kSize, kSize, 0.01F);
  add_vortex(slopes, 6.4, 7.5);
  add_conjugate_vortex(slopes, 8.6, 7.5);
  const Found found = find(slopes, even_flux());
  ASSERT_EQ(found.vortices.size(), 2U);
  EXPECT_EQ(found.vortices[0].charge + found.vortices[1].charge, 0);
  EXPECT_NE(found.vortices[0].charge, 0);
}

TEST(WhitenedFinder, OneOfItsFourLensletsMayBeMissing) {
  for (const auto& [row, col] : {std::pair{7, 7}, {7, 8}, {8, 7}, {8, 8}}) {
    SCOPED_TRACE(::testing::Message() << row << ", " << col);
    SlopeField slopes = flat_field(kSize, kSize, 0.01F);
    add_vortex(slopes, 7.5, 7.5);
    remove_lenslet(slopes, row, col);
    const Found found = find(slopes, even_flux());
    ASSERT_EQ(found.vortices.size(), 1U);
    EXPECT_EQ(found.only().charge, 1);
    EXPECT_NEAR(found.only().x, 7.5, 0.6);
    EXPECT_NEAR(found.only().y, 7.5, 0.6);
    EXPECT_NE(found.only().flags & kVortexAtHole, 0U);
  }
}

TEST(WhitenedFinder, TheRimSaysSo) {
  SlopeField slopes = flat_field(kSize, kSize, 0.01F);
  add_vortex(slopes, 0.5, 7.5);
  const Found found = find(slopes, even_flux());
  ASSERT_EQ(found.vortices.size(), 1U);
  EXPECT_NE(found.only().flags & kVortexAtPupilEdge, 0U);
}

TEST(WhitenedFinder, NotANumberIsNoVortex) {
  SlopeField slopes = flat_field(kSize, kSize, 0.01F);
  slopes.x(5, 5) = std::nanf("");
  slopes.y(9, 9) = INFINITY;
  EXPECT_TRUE(find(slopes, even_flux()).vortices.empty());
}

/// In white slope noise at two levels, vortices are reported at the stated rate.
TEST(WhitenedFinder, FalseAlarmsAreAsStated) {
  constexpr unsigned kSeed = 21;
  SCOPED_TRACE(kSeed);
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__) || !defined(NDEBUG)
  constexpr int kFrames = 1500;
#else
  constexpr int kFrames = 8000;
#endif
  WhitenedOptions options;
  options.false_alarms_per_frame = 0.1;
  options.min_probability = 1e-6;
  options.pair_sigmas = 0.0;
  const Image<std::uint8_t> lenslets(kSize, kSize, 1);
  const WhitenedPlan plan(options, lenslets, 64);
  WhitenedWorkspace workspace(plan);
  CirculationMap map(kSize, kSize);
  VortexList vortices(plan.capacity());
  std::mt19937 random(kSeed);
  std::normal_distribution<float> normal;
  for (const float variance : {0.005F, 0.1F}) {
    SlopeField slopes = flat_field(kSize, kSize, variance);
    const float sigma = std::sqrt(variance);
    std::size_t alarms = 0;
    for (int frame = 0; frame < kFrames; ++frame) {
      for (std::size_t k = 0; k < slopes.x.size(); ++k) {
        slopes.x[k] = sigma * normal(random);
        slopes.y[k] = sigma * normal(random);
      }
      find_whitened_vortices(plan, slopes, Image<float>(kSize, kSize, 1.0F), map, workspace,
                             vortices);
      alarms += vortices.size();
    }
    const double stated = options.false_alarms_per_frame * kFrames;
    EXPECT_NEAR(static_cast<double>(alarms) / stated, 1.0, 0.10 + 3.0 / std::sqrt(stated))
        << "variance " << variance;
  }
}

TEST(WhitenedFinder, RefusesOptionsThatMakeNoSense) {
  const Image<std::uint8_t> lenslets(4, 4, 1);
  const auto refused = [&](auto change) {
    WhitenedOptions options;
    change(options);
    EXPECT_THROW(WhitenedPlan(options, lenslets, 4), UsageError);
  };
  refused([](WhitenedOptions& o) { o.false_alarms_per_frame = 0.0; });
  refused([](WhitenedOptions& o) { o.min_probability = 1.0; });
  refused([](WhitenedOptions& o) { o.slope_clutter_rad2 = 0.0; });
  refused([](WhitenedOptions& o) { o.log_odds_per_sigma = 0.0; });
  refused([](WhitenedOptions& o) { o.pair_sigmas = -1.0; });
}

TEST(FalseAlarmControl, MarksTheSignOfWhatStandsOut) {
  CirculationMap map(2, 5);
  map.value[0] = 3.1F;
  map.value[1] = -3.1F;
  map.value[2] = 2.9F;
  map.value[3] = 100.0F;
  map.variance.fill(1.0F);
  map.valid.fill(1);
  map.valid[3] = 0;
  Image<std::int8_t> marks(1, 4);
  mark_significant(map, 3.0F, marks);
  EXPECT_EQ(marks[0], 1);
  EXPECT_EQ(marks[1], -1);
  EXPECT_EQ(marks[2], 0);
  EXPECT_EQ(marks[3], 0);
  mark_significant(map, INFINITY, marks);
  for (const std::int8_t mark : marks) EXPECT_EQ(mark, 0);
}

// If unlikely vortices are asked for as well, no likely one may vanish, not even into a pair.
TEST(WhitenedFinder, WhatIsLikelyStaysWhenUnlikelyOnesAreAskedFor) {
  std::mt19937 random(7901);
  std::normal_distribution<float> noise(0.0F, 0.45F);
  std::uniform_real_distribution<double> place(2.0, kSize - 3.0);
  std::size_t likely = 0;
  std::size_t more = 0;
  for (int frame = 0; frame < 60; ++frame) {
    SCOPED_TRACE(frame);
    SlopeField slopes = flat_field(kSize, kSize, 0.2F);
    for (std::size_t k = 0; k < slopes.x.size(); ++k) {
      slopes.x[k] += noise(random);
      slopes.y[k] += noise(random);
    }
    for (int i = 0; i < 3; ++i) {
      const double x = place(random);
      const double y = place(random);
      add_vortex(slopes, x, y);
      add_conjugate_vortex(slopes, x + 0.9, y + 0.6);
    }
    WhitenedOptions options;
    options.false_alarms_per_frame = 1.0;
    const Found sure = find(slopes, even_flux(), options);
    options.min_probability = 0.02;
    const Found all = find(slopes, even_flux(), options);
    for (const Vortex& vortex : sure.vortices) {
      EXPECT_TRUE(std::any_of(all.vortices.begin(), all.vortices.end(), [&](const Vortex& other) {
        return other.x == vortex.x && other.y == vortex.y && other.charge == vortex.charge;
      }));
    }
    likely += sure.vortices.size();
    more += all.vortices.size();
  }
  EXPECT_GT(likely, 60U);
  EXPECT_GT(more, likely);
}

}  // namespace
}  // namespace curlew
