// The product of two small float matrices: all that a network's layers need, forth and back.
#pragma once

#include <cstddef>

namespace curlew {

/// Columns of a product come in multiples of this.
inline constexpr int kProductColumns = 8;

/// Element (row, column) lies at data[row·row_step + column·column_step].
struct StridedMatrix {
  const float* data = nullptr;
  std::ptrdiff_t row_step = 0;
  std::ptrdiff_t column_step = 1;
};

/// c = a·b + bias, or max(a·b + bias, 0) if `rectify`.
/// a: [rows, inner]; b: [inner, columns] without gaps; bias: [columns], none: zeros; c: [rows,
/// columns] without gaps, columns a multiple of kProductColumns. Vectors run along the columns, and
/// every element is summed in order of the inner index, so an element does not depend on how many
/// rows are multiplied with it. Same instruction set, same bits.
void multiply(StridedMatrix a, const float* b, const float* bias, int rows, int inner, int columns,
              bool rectify, float* c) noexcept;

}  // namespace curlew
