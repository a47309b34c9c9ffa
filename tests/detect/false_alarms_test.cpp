#include "detect/false_alarms.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <random>
#include <string>

#include "detect/circulation.h"
#include "detect/circulation_finder.h"
#include "tests/detect/vortex_slopes.h"

namespace curlew {
namespace {

TEST(FalseAlarms, InverseTailAgainstTables) {
  EXPECT_NEAR(gaussian_tail_inverse(0.025), 1.959963984540054, 1e-14);
  EXPECT_NEAR(gaussian_tail_inverse(0.975), -1.959963984540054, 1e-13);
  EXPECT_NEAR(gaussian_tail_inverse(0.5), 0.0, 1e-15);
  EXPECT_NEAR(gaussian_tail_inverse(0.0013498980316300945), 3.0, 1e-13);
  EXPECT_NEAR(gaussian_tail_inverse(2.8665157187919391e-7), 5.0, 1e-13);
  for (const double p : {0.4, 1e-2, 1e-5, 1e-10, 1e-100, 1e-300}) {
    EXPECT_NEAR(gaussian_tail(gaussian_tail_inverse(p)) / p, 1.0, 1e-11) << p;
  }
}

TEST(FalseAlarms, ThresholdSolves2NQ) {
  // With few alarms in many cells, the neighbours' suppression is a correction of some 4·Q.
  for (const double rate : {1.0, 0.1, 0.01}) {
    const double z = threshold_sigmas(rate, 6241);
    EXPECT_NEAR(2 * 6241 * gaussian_tail(z) / rate, 1.0, 1e-3);
    // What is suppressed must be made up for.
    EXPECT_GE(2 * 6241 * gaussian_tail(z), rate);
  }
  // The definition holds for a small array, too.
  for (const double n : {1.0, 9.0, 225.0}) {
    for (const double rate : {0.3, 0.01, 1e-6}) {
      const CellNeighbours neighbours{2.7, 1.8};
      const double z = threshold_sigmas(rate, n, neighbours);
      EXPECT_NEAR(2 * n * peak_probability(z, neighbours) / rate, 1.0, 1e-7);
    }
  }
}

TEST(FalseAlarms, ALoneCellHasNobodyToSuppressIt) {
  for (const double z : {0.0, 1.0, 3.0, 6.0}) {
    // This is the accuracy of Simpson's rule with its 200 intervals.
    EXPECT_NEAR(peak_probability(z, {0.0, 0.0}) / gaussian_tail(z), 1.0, 3e-6);
  }
}

TEST(FalseAlarms, Extremes) {
  EXPECT_TRUE(std::isinf(threshold_sigmas(0.01, 0)));
  EXPECT_EQ(threshold_sigmas(1e6, 9), 0.0);  // This is more than noise can make.
  EXPECT_GT(threshold_sigmas(1e-12, 6241), 8.0);
  EXPECT_TRUE(std::isfinite(threshold_sigmas(1e-200, 6241)));
  EXPECT_LT(threshold_sigmas(0.1, 100), threshold_sigmas(0.1, 101));
  EXPECT_LT(threshold_sigmas(0.11, 100), threshold_sigmas(0.1, 100));
}

struct Pupil {
  const char* name;
  int size;
  double outer;  // radii in pitches; inner is the hole's
  double inner;
  bool uneven;  // lenslets differ in noise, and x and y are correlated
};

class FalseAlarmRate : public ::testing::TestWithParam<Pupil> {};

/// Returns the false alarms per frame in seeded white slope noise.
double realised_rate(const Pupil& pupil, double rate, int frames, unsigned seed) {
  const int n = pupil.size;
  SlopeField slopes = testing::flat_field(n, n);
  for (int r = 0; r < n; ++r) {
    for (int c = 0; c < n; ++c) {
      const double radius = std::hypot(r - 0.5 * (n - 1), c - 0.5 * (n - 1));
      if (radius > pupil.outer || radius < pupil.inner) testing::remove_lenslet(slopes, r, c);
    }
  }
  CirculationOptions options;
  options.false_alarms_per_frame = rate;
  const CirculationPlan plan(options, slopes.valid, 64);
  CirculationMap map(n, n);
  VortexList vortices(plan.capacity());
  std::mt19937 random(seed);
  std::normal_distribution<float> noise(0.0F, 1.0F);
  double alarms = 0.0;
  for (int frame = 0; frame < frames; ++frame) {
    for (std::size_t k = 0; k < slopes.x.size(); ++k) {
      if (slopes.valid[k] == 0) continue;
      const float sx = pupil.uneven ? 0.2F + 0.1F * static_cast<float>(k % 7) : 0.3F;
      const float sy = pupil.uneven ? 0.2F + 0.1F * static_cast<float>(k % 5) : 0.3F;
      const float rho = pupil.uneven ? 0.5F * (static_cast<float>(k % 3) - 1.0F) : 0.0F;
      const float a = noise(random);
      const float b = noise(random);
      slopes.x[k] = sx * a;
      slopes.y[k] = sy * (rho * a + std::sqrt(1.0F - rho * rho) * b);
      slopes.variance_x[k] = sx * sx;
      slopes.variance_y[k] = sy * sy;
      slopes.covariance_xy[k] = rho * sx * sy;
    }
    circulate(slopes, map);
    find_circulation_vortices(plan, map, vortices);
    alarms += static_cast<double>(vortices.size()) + vortices.overflow();
  }
  return alarms / frames;
}

TEST_P(FalseAlarmRate, IsTheStatedOne) {
  constexpr unsigned kAlarmSeed = 4242;
  SCOPED_TRACE("seed " + std::to_string(kAlarmSeed));
  struct Case {
    double rate;
    int frames;
  };
  for (const Case& c : {Case{1.0, 8000}, {0.1, 16000}, {0.01, 40000}}) {
    const double realised = realised_rate(GetParam(), c.rate, c.frames, kAlarmSeed);
    // Poisson scatter of four standard deviations is 4.5 %, 10 % and 20 %. Over a million frames
    // the rate is right within 1.5 %.
    const double scatter = 4.0 * std::sqrt(c.rate / c.frames);
    EXPECT_NEAR(realised, c.rate, scatter);
  }
}

INSTANTIATE_TEST_SUITE_P(Pupils, FalseAlarmRate,
                         ::testing::Values(Pupil{"square16", 16, 99.0, -1.0, false},
                                           Pupil{"annulus16", 16, 8.2, 2.5, false},
                                           Pupil{"square4", 4, 99.0, -1.0, false},
                                           Pupil{"uneven12", 12, 99.0, -1.0, true}),
                         [](const auto& test) { return std::string(test.param.name); });

}  // namespace
}  // namespace curlew
