#include "service/bench/split_benchmark.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

#include "service/bench/plain_split.h"
#include "tests/support/pupils.h"

namespace curlew {
namespace {

/// The curl-free slopes (x and y of each valid lenslet in raster order) by a dense solver that
/// takes matrices of any rank.
Eigen::VectorXd dense_curl_free(const SlopeField& slopes, bool weighted) {
  const int cols = slopes.cols();
  const int corners = (slopes.rows() + 1) * (cols + 1);
  Eigen::MatrixXd gamma = Eigen::MatrixXd::Zero(2 * slopes.n_valid, corners);
  Eigen::VectorXd measured(2 * slopes.n_valid);
  Eigen::VectorXd root_weight(2 * slopes.n_valid);
  int row = 0;
  for (int r = 0; r < slopes.rows(); ++r) {
    for (int c = 0; c < cols; ++c) {
      if (slopes.valid(r, c) == 0) continue;
      const int corner = r * (cols + 1) + c;
      for (const auto& [of, sign_x, sign_y] :
           {std::tuple{corner, -0.5, -0.5}, std::tuple{corner + 1, 0.5, -0.5},
            std::tuple{corner + cols + 1, -0.5, 0.5}, std::tuple{corner + cols + 2, 0.5, 0.5}}) {
        gamma(row, of) = sign_x;
        gamma(row + 1, of) = sign_y;
      }
      measured[row] = static_cast<double>(slopes.x(r, c));
      measured[row + 1] = static_cast<double>(slopes.y(r, c));
      const double variance = static_cast<double>(slopes.variance_x(r, c)) +
                              static_cast<double>(slopes.variance_y(r, c));
      root_weight[row] = root_weight[row + 1] = weighted ? std::sqrt(2.0 / variance) : 1.0;
      row += 2;
    }
  }
  const Eigen::MatrixXd weighted_gamma = root_weight.asDiagonal() * gamma;
  const Eigen::VectorXd weighted_slopes = root_weight.cwiseProduct(measured);
  return gamma * weighted_gamma.completeOrthogonalDecomposition().solve(weighted_slopes);
}

template <typename Scalar>
void expect_dense_solution(const Image<std::uint8_t>& pupil, const SlopeField& slopes,
                           bool weighted, double tolerance) {
  PlainSplit<Scalar> plain(pupil);
  plain.factorise(slopes, weighted);
  plain.solve(slopes, 1);
  const Eigen::VectorXd expected = dense_curl_free(slopes, weighted);
  int row = 0;
  for (std::size_t k = 0; k < pupil.size(); ++k) {
    if (slopes.valid[k] == 0) {
      EXPECT_EQ(plain.curl_free_x()[k], Scalar{0});
      EXPECT_EQ(plain.curl_free_y()[k], Scalar{0});
      continue;
    }
    EXPECT_NEAR(static_cast<double>(plain.curl_free_x()[k]), expected[row], tolerance) << k;
    EXPECT_NEAR(static_cast<double>(plain.curl_free_y()[k]), expected[row + 1], tolerance) << k;
    row += 2;
  }
}

TEST(PlainSplit, IsTheDenseLeastSquaresSolution) {
  const Image<std::uint8_t> pupil = obscured_pupil(13, 15);
  for (const SplitDisturbance disturbance : kSplitDisturbances) {
    SCOPED_TRACE(name_of(disturbance));
    const bool weighted = disturbance == SplitDisturbance::kWeighted;
    const SlopeField slopes = disturbed_slopes(pupil, disturbance, 3);
    expect_dense_solution<double>(pupil, slopes, weighted, 1e-12);
    // Slopes up to 3 in float, summed across 15 lenslets.
    expect_dense_solution<float>(pupil, slopes, weighted, 5e-5);
  }
}

TEST(PlainSplit, WhereFadesSplitThePupil) {
  const Image<std::uint8_t> pupil =
      testing::pupil_from({"###.###.##", "##########", "###.###.##", "###.###.##"});
  SlopeField slopes = disturbed_slopes(pupil, SplitDisturbance::kWeighted, 4);
  // The bridges, and all of the right part but one that hangs by a corner.
  for (const auto& [r, c] : {std::pair{1, 3}, {1, 7}, {0, 8}, {1, 9}, {2, 8}, {3, 9}, {3, 8}}) {
    slopes.valid(r, c) = 0;
    slopes.x(r, c) = slopes.y(r, c) = 0.0F;
    --slopes.n_valid;
  }
  for (const bool weighted : {false, true})
    expect_dense_solution<double>(pupil, slopes, weighted, 1e-12);
}

TEST(SplitBenchmark, FadesAsManyAsItSays) {
  const Image<std::uint8_t> pupil = obscured_pupil(40, 40);
  const auto lit = static_cast<int>(std::count(pupil.begin(), pupil.end(), 1));
  EXPECT_EQ(pupil(19, 20), 0);  // behind the obscuration
  EXPECT_EQ(pupil(0, 0), 0);
  for (const auto& [disturbance, faded] :
       {std::pair{SplitDisturbance::kNone, 0},
        {SplitDisturbance::kOneFaded, 1},
        {SplitDisturbance::kOnePercentFaded, static_cast<int>(std::lround(0.01 * lit))},
        {SplitDisturbance::kFivePercentFaded, static_cast<int>(std::lround(0.05 * lit))},
        {SplitDisturbance::kCrossesFaded, static_cast<int>(std::lround(0.05 * lit))},
        {SplitDisturbance::kWeighted, 0}}) {
    const SlopeField slopes = disturbed_slopes(pupil, disturbance, 1);
    EXPECT_EQ(slopes.n_valid, lit - faded) << name_of(disturbance);
    EXPECT_EQ(std::count(slopes.valid.begin(), slopes.valid.end(), 1), slopes.n_valid);
  }
}

TEST(SplitBenchmark, FindsTheSplitRight) {
  int steps = 0;
  const SplitBenchmark result = time_splits(12, 14, 1, [&] { ++steps; });
  EXPECT_EQ(steps, static_cast<int>(kSplitDisturbances.size()));
  ASSERT_EQ(result.times.size(), kSplitDisturbances.size());
  for (const SplitTimes& times : result.times) {
    SCOPED_TRACE(name_of(times.disturbance));
    EXPECT_TRUE(times.converged);
    EXPECT_LT(times.worst_error, 1e-5);
    EXPECT_GT(times.worst_error, 0.0);
    EXPECT_GT(times.cold.median_us, 0.0);
    EXPECT_GT(times.plain_float.median_us, 0.0);
    EXPECT_GT(times.plain_double.median_us, 0.0);
    EXPECT_EQ(times.iterations > 0, times.disturbance != SplitDisturbance::kNone);
  }
  EXPECT_GT(result.times.front().plain_kept.median_us, 0.0);
}

}  // namespace
}  // namespace curlew
