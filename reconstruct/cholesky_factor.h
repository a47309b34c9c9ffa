// CholeskyFactor: a sparse A = L·Lᵀ made once in double, solved with in float without allocating.
#pragma once

#include <Eigen/SparseCore>
#include <cstdint>
#include <vector>

#include "core/image.h"

namespace curlew {

class CholeskyFactor {
 public:
  /// a: symmetric positive definite, lower triangle used. Throws Failure where it is not.
  explicit CholeskyFactor(const Eigen::SparseMatrix<double>& a);

  int size() const { return static_cast<int>(inverse_diagonal_.size()); }

  /// Where unknown i of A stands in the order of elimination. Vectors given to solve_in_place are
  /// in that order, so that no solve has to permute.
  const std::vector<int>& position() const { return position_; }

  /// b ← A⁻¹ b, b: [size()] in elimination order.
  void solve_in_place(float* b) const noexcept;

 private:
  std::vector<int> position_;
  std::vector<std::int32_t> column_start_;  // [size()+1], strictly lower part of L by columns
  AlignedVector<std::int32_t> row_;
  AlignedVector<float> values_;
  AlignedVector<float> inverse_diagonal_;
};

}  // namespace curlew
