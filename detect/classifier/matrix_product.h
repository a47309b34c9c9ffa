// This file declares the product of two small float matrices, which is all that a network's layers
// need to be applied and to be trained.
#pragma once

#include <cstddef>

namespace curlew {

/// The number of columns of a product is a multiple of this.
inline constexpr int kProductColumns = 8;

/// In this matrix, element (row, column) lies at data[row·row_step + column·column_step].
struct StridedMatrix {
  const float* data = nullptr;
  std::ptrdiff_t row_step = 0;
  std::ptrdiff_t column_step = 1;
};

/// Computes c = a·b + bias, or max(a·b + bias, 0) if `rectify`. Here a is [rows, inner], b is
/// [inner, columns] without gaps, and c is [rows, columns] without gaps; bias is [columns], or null
/// for zeros. `columns` must be a multiple of kProductColumns. Vectors run along the columns, and
/// every element is summed in the order of the inner index. Therefore an element does not depend on
/// how many rows are multiplied with it. The same instruction set gives the same bits.
void multiply(StridedMatrix a, const float* b, const float* bias, int rows, int inner, int columns,
              bool rectify, float* c) noexcept;

}  // namespace curlew
