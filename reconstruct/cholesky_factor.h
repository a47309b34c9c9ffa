// A CholeskyFactor is a sparse A = L·Lᵀ. It is made once in double, and solves with L in float, for
// many vectors side by side, without allocating.
#pragma once

#include <Eigen/SparseCore>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/image.h"

namespace curlew {

class CholeskyFactor {
 public:
  static constexpr int kLanes = 16;  ///< vectors that are solved side by side

  /// Takes a symmetric positive definite matrix, of which it uses the lower triangle. Throws
  /// Failure where the matrix is not positive definite.
  explicit CholeskyFactor(const Eigen::SparseMatrix<double>& a);

  int size() const { return static_cast<int>(inverse_diagonal_.size()); }

  /// Returns where unknown i of A stands in the order of elimination. Vectors given to
  /// solve_lower_in_place() are in that order, so that nothing has to be permuted.
  const std::vector<int>& position() const { return position_; }

  /// Computes b ← L⁻¹ b for kLanes vectors. b is [size(), kLanes] in elimination order, and begins
  /// where an AlignedVector may. For two vectors b and c, the product of the results is bᵀA⁻¹c.
  void solve_lower_in_place(float* b) const noexcept;

 private:
  std::vector<int> position_;
  std::vector<std::int32_t> column_start_;  // [size()+1]; strictly lower part of L by columns
  AlignedVector<std::int32_t> row_;
  AlignedVector<float> values_;
  AlignedVector<float> inverse_diagonal_;
};

/// Computes the products of kLanes vectors with kLanes others: the product of a's vector i with b's
/// vector j goes to products[i·stride + j]. a and b are [n, kLanes] and begin where an
/// AlignedVector may.
void multiply_lanes(const float* a, const float* b, int n, float* products,
                    std::ptrdiff_t stride) noexcept;

}  // namespace curlew
