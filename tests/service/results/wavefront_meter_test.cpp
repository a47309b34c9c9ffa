// The rms and the peak to valley of wavefronts that are known, from the split of their slopes.
#include "service/results/wavefront_meter.h"

#include <gtest/gtest.h>

#include <Eigen/QR>
#include <cmath>
#include <iostream>
#include <numbers>
#include <random>
#include <vector>

#include "core/zernike.h"
#include "reconstruct/split.h"
#include "tests/support/mean_slopes.h"
#include "tests/support/pupils.h"

namespace curlew {
namespace {

WavefrontFigures figures_of(const Phase& phase, const Image<std::uint8_t>& lit,
                            const Image<std::uint8_t>& valid) {
  const SplitPlan plan(lit, {});
  SplitWorkspace workspace(plan);
  HodgeSplit split(lit.rows(), lit.cols());
  const SlopeField slopes = slopes_of(phase, valid);
  split_slopes(plan, slopes, workspace, split);
  return WavefrontMeter(plan).measure(split.phase, slopes);
}

/// Returns the figures of the phase itself at the centres of the lenslets, less its plane.
WavefrontFigures true_figures(const Phase& phase, const Image<std::uint8_t>& valid) {
  std::vector<Eigen::Vector4d> values;  // 1, x, y, phase
  for (int row = 0; row < valid.rows(); ++row)
    for (int col = 0; col < valid.cols(); ++col)
      if (valid(row, col) != 0) values.emplace_back(1.0, col, row, phase(col, row));
  const Eigen::Map<const Eigen::Matrix<double, 4, Eigen::Dynamic>> all(values.front().data(), 4,
                                                                       std::ssize(values));
  const Eigen::MatrixXd plane = all.topRows(3).transpose();
  const Eigen::VectorXd phases = all.row(3).transpose();
  const Eigen::VectorXd rest = phases - plane * plane.colPivHouseholderQr().solve(phases).eval();
  return {std::sqrt(rest.squaredNorm() / static_cast<double>(rest.size())),
          rest.maxCoeff() - rest.minCoeff()};
}

/// Returns a Zernike polynomial over 20 x 20 lenslets.
Phase mode(int noll) {
  return [z = Zernike(noll)](double x, double y) { return z((x - 9.5) / 10.0, (y - 9.5) / 10.0); };
}

TEST(WavefrontMeter, OfZernikesTheFiguresAreTheirOwn) {
  for (const double hole : {0.0, 0.3}) {
    const Image<std::uint8_t> lit = testing::annular_pupil(20, hole);
    for (int noll = 4; noll <= 36; ++noll) {
      const Phase phase = mode(noll);
      const WavefrontFigures truth = true_figures(phase, lit);
      const WavefrontFigures found = figures_of(phase, lit, lit);
      EXPECT_NEAR(found.rms_rad / truth.rms_rad, 1.0, 0.001) << "Noll " << noll << " hole " << hole;
      EXPECT_NEAR(found.peak_to_valley_rad / truth.peak_to_valley_rad, 1.0, 0.001)
          << "Noll " << noll << " hole " << hole;
    }
  }
}

TEST(WavefrontMeter, FadedLensletsChangeTheFiguresLittle) {
  std::mt19937 random(5);
  std::cout << "seed 5\n";
  const Image<std::uint8_t> lit = testing::annular_pupil(20, 0.3);
  const Image<std::uint8_t> valid = testing::knock_out(lit, 0.05, random);
  for (int noll = 4; noll <= 36; ++noll) {
    const Phase phase = mode(noll);
    const WavefrontFigures truth = true_figures(phase, valid);
    EXPECT_NEAR(figures_of(phase, lit, valid).rms_rad, truth.rms_rad, 0.01 * truth.rms_rad)
        << "Noll " << noll;
  }
}

TEST(WavefrontMeter, OfAPlaneAreZeroAndOfALineUnknown) {
  const Image<std::uint8_t> lit = testing::square_pupil(6);
  const Phase plane = [](double x, double y) { return 0.3 * x - 0.2 * y; };
  EXPECT_NEAR(figures_of(plane, lit, lit).rms_rad, 0.0, 1e-5);
  const Image<std::uint8_t> line(1, 6, 1);
  EXPECT_TRUE(std::isnan(figures_of(plane, line, line).rms_rad));
}

TEST(WavefrontMeter, AWaveHasItsOwnHeight) {
  // Periods of 10 lenslets in several directions: k² · 5/48 is .041 of the height.
  const Image<std::uint8_t> lit = testing::square_pupil(40);
  const double k = 2.0 * std::numbers::pi / 10.0;
  for (const double direction : {0.0, 0.3, std::numbers::pi / 4.0}) {
    const Phase phase = [&](double x, double y) {
      return std::cos(k * ((x - 19.5) * std::cos(direction) + (y - 19.5) * std::sin(direction)));
    };
    const double truth = true_figures(phase, lit).rms_rad;
    EXPECT_NEAR(figures_of(phase, lit, lit).rms_rad, truth, 0.015 * truth) << direction;
  }
}

}  // namespace
}  // namespace curlew
