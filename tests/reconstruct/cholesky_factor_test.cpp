#include "reconstruct/cholesky_factor.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <cstddef>
#include <random>
#include <vector>

#include "core/image.h"

namespace curlew {
namespace {

constexpr int kLanes = CholeskyFactor::kLanes;

/// Returns the Laplacian of a grid with a rim of zeros, plus a little.
Eigen::SparseMatrix<double> grid_laplacian(int side) {
  std::vector<Eigen::Triplet<double>> entries;
  for (int r = 0; r < side; ++r) {
    for (int c = 0; c < side; ++c) {
      const int k = r * side + c;
      entries.emplace_back(k, k, 4.1);
      if (c + 1 < side) entries.emplace_back(k + 1, k, -1.0);
      if (r + 1 < side) entries.emplace_back(k + side, k, -1.0);
    }
  }
  Eigen::SparseMatrix<double> a(side * side, side * side);
  a.setFromTriplets(entries.begin(), entries.end());
  return a;
}

// For all pairs of vectors of two groups, the products of the solutions are bᵀA⁻¹c.
TEST(CholeskyFactor, ProductsAreThoseOfTheInverse) {
  for (const int side : {1, 2, 13}) {
    SCOPED_TRACE(side);
    const Eigen::SparseMatrix<double> a = grid_laplacian(side);
    const CholeskyFactor factor(a);
    const int n = side * side;
    ASSERT_EQ(factor.size(), n);
    std::mt19937 random(11);
    std::normal_distribution<float> number;
    Eigen::MatrixXd b(n, 2 * kLanes);
    AlignedVector<float> lanes(static_cast<std::size_t>(2 * n * kLanes));
    for (int i = 0; i < n; ++i) {
      for (int lane = 0; lane < 2 * kLanes; ++lane) {
        const float value = number(random);
        b(i, lane) = static_cast<double>(value);
        const int place = factor.position()[static_cast<std::size_t>(i)];
        lanes[static_cast<std::size_t>((lane / kLanes * n + place) * kLanes + lane % kLanes)] =
            value;
      }
    }
    float* const first = lanes.data();
    float* const second = lanes.data() + std::ptrdiff_t{n} * kLanes;
    factor.solve_lower_in_place(first);
    factor.solve_lower_in_place(second);
    constexpr std::ptrdiff_t kStride = kLanes + 3;
    std::vector<float> products(kLanes * kStride, 7.0F);
    multiply_lanes(first, second, n, products.data(), kStride);
    const Eigen::MatrixXd lower(a);
    const Eigen::MatrixXd full = lower.selfadjointView<Eigen::Lower>();
    const Eigen::MatrixXd expected =
        b.leftCols(kLanes).transpose() * full.inverse() * b.rightCols(kLanes);
    for (int i = 0; i < kLanes; ++i) {
      for (std::ptrdiff_t j = 0; j < kStride; ++j) {
        const auto is = static_cast<double>(products[static_cast<std::size_t>(i * kStride + j)]);
        if (j < kLanes)
          EXPECT_NEAR(is, expected(i, j), 1e-5 * std::sqrt(n)) << i << ", " << j;
        else
          EXPECT_EQ(is, 7.0) << "beyond the lanes";
      }
    }
  }
}

}  // namespace
}  // namespace curlew
