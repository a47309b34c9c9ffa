// The low orders of how a frame's spots lie off their references.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>

namespace curlew {

/// Displacements of all spots, as quadratic polynomials Σ c_i·b_i with b = (1, u, v, u², u·v, v²).
/// u and v are the lenslet's column and row, scaled so that the array runs from −1 to 1.
struct LowOrders {
  static constexpr int kTerms = 6;
  std::array<float, kTerms> x{};
  std::array<float, kTerms> y{};

  std::array<float, 2> at(float u, float v) const noexcept {
    const std::array<float, kTerms> b{1.0F, u, v, u * u, u * v, v * v};
    std::array<float, 2> sum{};
    for (std::size_t i = 0; i < b.size(); ++i) {
      sum[0] += x[i] * b[i];
      sum[1] += y[i] * b[i];
    }
    return sum;
  }
  LowOrders& operator+=(const LowOrders& other) noexcept;

  /// The same along one row of lenslets, as polynomials of u.
  struct Row {
    std::array<float, 3> x{};
    std::array<float, 3> y{};

    std::array<float, 2> at(float u) const noexcept {
      return {x[0] + u * (x[1] + u * x[2]), y[0] + u * (y[1] + u * y[2])};
    }
  };
  Row along(float v) const noexcept {
    const auto terms = [v](const std::array<float, kTerms>& c) {
      return std::array<float, 3>{c[0] + v * (c[2] + v * c[5]), c[1] + v * c[4], c[3]};
    };
    return {terms(x), terms(y)};
  }
};

/// Returns u for column `col` of an array `cols` wide, and likewise v for a row.
inline float model_coordinate(float col, int cols) noexcept {
  return cols > 1 ? 2.0F * col / static_cast<float>(cols - 1) - 1.0F : 0.0F;
}

/// Fits a LowOrders to displacements by least squares. From 40 spots on it fits all six terms, from
/// 12 on the linear ones, and else only the mean.
class LowOrdersFit {
 public:
  void add(float u, float v, float x, float y) noexcept;
  LowOrders solve() const noexcept;

 private:
  using Terms = Eigen::Matrix<double, LowOrders::kTerms, 1>;
  Eigen::Matrix<double, LowOrders::kTerms, LowOrders::kTerms> normal_ =
      Eigen::Matrix<double, LowOrders::kTerms, LowOrders::kTerms>::Zero();
  Terms x_ = Terms::Zero();
  Terms y_ = Terms::Zero();
  int n_ = 0;
};

}  // namespace curlew
