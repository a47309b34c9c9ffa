// A CholeskyFactor is a sparse A = L·Lᵀ. It is made once in double, and solves with L in float
// without allocating.
#pragma once

#include <Eigen/SparseCore>
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/image.h"

namespace curlew {

class CholeskyFactor {
 public:
  /// Takes a symmetric positive definite matrix, of which it uses the lower triangle. Throws
  /// Failure where the matrix is not positive definite.
  explicit CholeskyFactor(const Eigen::SparseMatrix<double>& a);

  int size() const { return static_cast<int>(inverse_diagonal_.size()); }

  /// Returns where unknown i of A stands in the order of elimination. Vectors given to
  /// solve_lower_in_place() are in that order, so that nothing has to be permuted.
  const std::vector<int>& position() const { return position_; }

  /// Computes b ← L⁻¹ b, where b is [size()] in elimination order. The |b|² of the result is bᵀA⁻¹b
  /// of the b given.
  void solve_lower_in_place(float* b) const noexcept;

  /// Does one step of solve_lower_in_place(): that of column j, which changes b[j] and elements
  /// after it. Where b is zero except at a few places, only the columns of these places are needed
  /// and, for each of them, parent(j), parent(parent(j)) and so on.
  void eliminate(std::int32_t j, float* b) const noexcept {
    const auto column = static_cast<std::size_t>(j);
    const float y = b[j] * inverse_diagonal_[column];
    b[j] = y;
    for (std::int32_t i = column_start_[column]; i < column_start_[column + 1]; ++i)
      b[row_[static_cast<std::size_t>(i)]] -= values_[static_cast<std::size_t>(i)] * y;
  }
  /// Returns the first element that column j changes after b[j], and −1 if there is none.
  std::int32_t parent(std::int32_t j) const noexcept {
    const std::int32_t first = column_start_[static_cast<std::size_t>(j)];
    if (first == column_start_[static_cast<std::size_t>(j) + 1]) return -1;
    return row_[static_cast<std::size_t>(first)];
  }

 private:
  std::vector<int> position_;
  std::vector<std::int32_t> column_start_;  // [size()+1]; strictly lower part of L by columns
  AlignedVector<std::int32_t> row_;
  AlignedVector<float> values_;
  AlignedVector<float> inverse_diagonal_;
};

/// This finds the columns needed to eliminate a vector that is zero except at the elements added.
class EliminationPath {
 public:
  /// `marked` is [factor.size()] of zeros, and is zeros again afterwards. `columns` has room for
  /// them all.
  EliminationPath(const CholeskyFactor& factor, std::vector<std::uint8_t>& marked,
                  std::int32_t* columns)
      : factor_(factor), marked_(marked), columns_(columns) {}

  void add(std::int32_t element) {
    for (; element >= 0 && marked(element) == 0; element = factor_.parent(element)) {
      marked(element) = 1;
      columns_[size_++] = element;
    }
  }
  /// Sorts the columns into the order in which they are eliminated, and returns how many there are.
  std::size_t finish() {
    std::sort(columns_, columns_ + size_);
    for (std::size_t i = 0; i < size_; ++i) marked(columns_[i]) = 0;
    return size_;
  }

 private:
  std::uint8_t& marked(std::int32_t column) { return marked_[static_cast<std::size_t>(column)]; }

  const CholeskyFactor& factor_;
  std::vector<std::uint8_t>& marked_;
  std::int32_t* columns_;
  std::size_t size_ = 0;
};

}  // namespace curlew
