// The air's figures for phase screens and light whose statistics are known.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "acquisition/simulator/phase_screen.h"
#include "reconstruct/air/air_figures.h"

namespace curlew {
namespace {

constexpr int kLenslets = 16;
constexpr int kPoints = 8;  // along a lenslet
constexpr int kGrid = 256;  // twice the array, so that a screen's period does not count

Image<std::uint8_t> round_pupil() {
  Image<std::uint8_t> lit(kLenslets, kLenslets);
  for (int row = 0; row < kLenslets; ++row)
    for (int col = 0; col < kLenslets; ++col)
      lit(row, col) = std::hypot(row - 7.5, col - 7.5) <= 8.0 ? 1 : 0;
  return lit;
}

/// Draws samples as a sensor without vortices sees them, behind screens of one r0 (in pitches).
class Air {
 public:
  explicit Air(double r0) : screens_(kGrid, 1.0 / kPoints, {r0, 1e4, 0.0}, true, 3) {}

  /// noise: standard deviation that is added to each slope, rad a pitch.
  AirSample sample(std::int64_t frame, double noise, const ScreenShift& shift = {},
                   bool drifting = false) {
    screens_.draw(drifting ? 0 : frame, 0, shift, {}, fft_, drawn_);
    AirSample sample(kLenslets, kLenslets, 8);
    sample.sequence = frame;
    sample.time_s = 1e-3 * static_cast<double>(frame);
    SlopeField& slopes = sample.slopes;
    for (int row = 0; row < kLenslets; ++row)
      for (int col = 0; col < kLenslets; ++col) {
        if (lit_(row, col) == 0) continue;
        double x = 0.0;
        double y = 0.0;
        for (int i = 0; i < kPoints; ++i) {
          x += phase(row * kPoints + i, (col + 1) * kPoints) -
               phase(row * kPoints + i, col * kPoints);
          y += phase((row + 1) * kPoints, col * kPoints + i) -
               phase(row * kPoints, col * kPoints + i);
        }
        slopes.x(row, col) = static_cast<float>(x / kPoints + noise * normal_(random_));
        slopes.y(row, col) = static_cast<float>(y / kPoints + noise * normal_(random_));
        slopes.variance_x(row, col) = slopes.variance_y(row, col) =
            static_cast<float>(noise * noise);
        slopes.valid(row, col) = 1;
        ++slopes.n_valid;
      }
    return sample;
  }

  const Image<std::uint8_t>& lit() const { return lit_; }

 private:
  double phase(int row, int col) const { return static_cast<double>(drawn_(row, col).real()); }

  Image<std::uint8_t> lit_ = round_pupil();
  PhaseScreens screens_;
  SquareFft fft_{kGrid};
  Image<std::complex<float>> drawn_{kGrid, kGrid};
  std::mt19937 random_{5};
  std::normal_distribution<double> normal_;
};

// Over a lenslet of side d the mean gradient has the variance 6.40 (d/r0)^(5/3) rad² in each
// component, by double integrals of D = 6.88 (r/r0)^(5/3); far apart the mean covariance of two
// slopes is that of points, ¼∇²D = 6.88·25/36·r^(−1/3).
TEST(AirPlans, SlopesDifferAsTheStructureFunctionSays) {
  Image<std::uint8_t> one(400, 400);
  one(0, 0) = 1;  // the separation is all that counts
  const AirPlan large(one, {});
  ASSERT_EQ(large.separation(), 100);
  EXPECT_NEAR(large.pair_variance(), 6.401 - 6.88 * 25.0 / 36.0 * std::pow(100.0, -1.0 / 3.0),
              0.02);
  // Neighbours, with all their correlation, by the same double integrals in numbers.
  const Image<std::uint8_t> small(4, 4, 1);
  const auto between = [](double dx, double dy) {
    return 6.88 * std::pow(dx * dx + dy * dy, 5.0 / 6.0);
  };
  constexpr int n = 200;
  double along = 0.0;   // pairs that lie along the gradient
  double across = 0.0;  // pairs beside each other
  for (int i = -n; i <= n; ++i) {
    const double u = static_cast<double>(i) / n;
    const double weight = (1.0 - std::abs(u)) / n;
    const auto covariance = [&](double x, double y) {
      return 0.5 * (between(x + 1.0, y) + between(x - 1.0, y) - 2.0 * between(x, y));
    };
    along += weight * (covariance(0.0, u) - covariance(1.0, u));
    across += weight * (covariance(0.0, u) - covariance(0.0, u + 1.0));
  }
  EXPECT_NEAR(AirPlan(small, {}).pair_variance() / (0.5 * (along + across)), 1.0, 0.01);
}

// R. J. Noll, J. Opt. Soc. Am. 66, 207 (1976), Table IV: what is left after 3, 6 and 10 modes are
// .134, .0648 and .0401 (D/r0)^(5/3), so that orders 2 and 3 have .134 − .0401 in all. Higher modes
// add a little to what is fitted.
TEST(AirPlans, ModesHaveNollsVariances) {
  const AirPlan plan(round_pupil(), {});
  ASSERT_EQ(plan.mode_count(), 7);
  const double noll = (0.134 - 0.0401) * std::pow(16.0, 5.0 / 3.0);
  EXPECT_NEAR(plan.mode_variance().sum() / noll, 1.02, 0.04);
}

class R0 : public ::testing::TestWithParam<double> {};

TEST_P(R0, IsThatOfTheScreensByBothWays) {
  Air air(GetParam());
  const AirPlan plan(air.lit(), {});
  AirWindow window(plan, {});
  for (int i = 0; i < 150; ++i) window.add(air.sample(i, 0.3));
  const AirFigures figures = window.figures();
  EXPECT_EQ(figures.frames, 150);
  EXPECT_NEAR(figures.r0_slopes.value / GetParam(), 1.0, 0.03);
  EXPECT_NEAR(figures.r0_zernike.value / GetParam(), 1.0, 0.06);
  for (const AirFigure& figure : {figures.r0_slopes, figures.r0_zernike}) {
    EXPECT_GT(figure.error, 0.0);
    EXPECT_LT(std::abs(figure.value - GetParam()), 4.0 * figure.error) << figure.error;
  }
  // No two frames are alike, so there is no wind to be seen.
  EXPECT_TRUE(std::isnan(figures.wind_x.value)) << figures.wind_x.value;
}
INSTANTIATE_TEST_SUITE_P(Strengths, R0, ::testing::Values(0.8, 2.0, 5.0));

TEST(AirFigure, NoiseAloneIsNoAir) {
  Air air(1e6);
  const AirPlan plan(air.lit(), {});
  AirWindow window(plan, {});
  for (int i = 0; i < 64; ++i) window.add(air.sample(i, 0.3));
  const AirFigures figures = window.figures();
  // The variance left over is chance: an r0 that is large, or none.
  EXPECT_FALSE(figures.r0_slopes.value < 10.0) << figures.r0_slopes.value;
  EXPECT_TRUE(std::isnan(figures.wind_x.value));
}

struct Drift {
  double x, y;  // pitches a frame
};
class Wind : public ::testing::TestWithParam<Drift> {};

TEST_P(Wind, IsTheDriftOfTheScreens) {
  const auto [x, y] = GetParam();
  Air air(1.5);
  const AirPlan plan(air.lit(), {});
  AirWindow window(plan, {});
  for (int i = 0; i < 150; ++i) window.add(air.sample(i, 0.2, {x * i, y * i}, true));
  const AirFigures figures = window.figures();
  const double speed = 1000.0 * std::hypot(x, y);  // pitches a second, at 1 kHz
  // The peak's parabola is drawn towards whole lenslets, by a tenth of a pitch at most.
  EXPECT_NEAR(figures.wind_x.value, 1000.0 * x, 0.08 * speed);
  EXPECT_NEAR(figures.wind_y.value, 1000.0 * y, 0.08 * speed);
  EXPECT_LT(figures.wind_x.error, 0.1 * speed);
  EXPECT_NEAR(figures.tau0.value, 0.314 * figures.r0_slopes.value / speed,
              0.1 * figures.tau0.value);
}
INSTANTIATE_TEST_SUITE_P(Drifts, Wind,
                         ::testing::Values(Drift{0.2, 0.0}, Drift{-0.35, 0.2}, Drift{0.1, -1.1}));

TEST(AirFigure, ScintillationIsLessNoise) {
  Air still(1e6);
  const AirPlan plan(still.lit(), {});
  AirWindow window(plan, {0.5, 2.0});
  std::mt19937 random(11);
  std::gamma_distribution<double> light(4.0, 1.0);  // its index is 1/4
  std::normal_distribution<double> noise;
  for (int i = 0; i < 200; ++i) {
    AirSample sample(kLenslets, kLenslets, 8);
    sample.sequence = i;
    sample.time_s = i;
    for (std::size_t k = 0; k < sample.state.size(); ++k) {
      if (still.lit()[k] == 0) continue;
      sample.state[k] = LensletState::kValid;
      sample.area_px[k] = 10.0F;
      const double mean = (1.0 + static_cast<double>(k)) * light(random);  // lit unevenly
      sample.light_adu[k] = static_cast<float>(mean + std::sqrt(0.5 * mean + 20.0) * noise(random));
    }
    window.add(sample);
  }
  const AirFigures figures = window.figures();
  EXPECT_NEAR(figures.scintillation.value, 0.25, 0.01);
  EXPECT_LT(std::abs(figures.scintillation.value - 0.25), 4.0 * figures.scintillation.error);
  EXPECT_TRUE(std::isnan(figures.r0_slopes.value)) << "there was no slope";
}

TEST(AirFigure, VorticesHaveDensityAndDrift) {
  Air still(1e6);
  const AirPlan plan(still.lit(), {});
  AirWindow window(plan, {});
  for (int i = 0; i < 40; ++i) {
    AirSample sample(kLenslets, kLenslets, 8);
    sample.sequence = i;
    sample.vortices.push({.charge = 1, .velocity_x = 3.0F, .velocity_y = -1.0F, .track = 4});
    sample.vortices.push({.charge = -1, .velocity_x = 5.0F, .velocity_y = -1.0F, .track = 5});
    sample.vortices.push({.charge = 1});
    window.add(sample);
  }
  const AirFigures figures = window.figures();
  const auto lit = std::count(still.lit().begin(), still.lit().end(), 1);
  EXPECT_NEAR(figures.vortex_density.value, 3.0 / static_cast<double>(lit), 1e-9);
  EXPECT_NEAR(figures.vortex_wind_x.value, 4.0, 1e-6);
  EXPECT_NEAR(figures.vortex_wind_y.value, -1.0, 1e-6);
}

TEST(AirFigure, ManyFramesAndLostOnesAreSummedInBlocks) {
  Air air(2.0);
  const AirPlan plan(air.lit(), {});
  AirWindow window(plan, {});
  AirSample sample = air.sample(0, 0.0);
  for (int i = 0; i < 1000; ++i) {
    sample.sequence = 3 * i;  // two of three frames are lost
    sample.time_s = 0.003 * i;
    window.add(sample);
  }
  const AirFigures figures = window.figures();
  EXPECT_EQ(figures.frames, 1000);
  EXPECT_NEAR(figures.seconds, 2.997, 1e-6);
  EXPECT_NEAR(figures.r0_slopes.error / figures.r0_slopes.value, 0.0, 1e-6);
  window.begin_anew();
  EXPECT_EQ(window.figures().frames, 0);
  EXPECT_TRUE(std::isnan(window.figures().r0_slopes.value));
}

}  // namespace
}  // namespace curlew
