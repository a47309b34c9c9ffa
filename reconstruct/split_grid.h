// A SplitGrid says where lenslets and corners lie in the split's working arrays.
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/as_size.h"

namespace curlew {

/// A working array holds one value per lenslet, or one per corner, in rows. Zeros surround them, so
/// that loops need no special cases at the rim, and rows are long enough for whole vectors. The
/// place of a lenslet is that of its corner 00; corner 01 is one place farther, corners 10 and 11 a
/// stride farther than these.
struct SplitGrid {
  SplitGrid(int lenslet_rows, int lenslet_cols)
      : rows(lenslet_rows),
        cols(lenslet_cols),
        stride(as_size((lenslet_cols + 1 + 15) / 16 * 16 + 16)) {}

  /// The last vector of the last row may reach beyond it.
  std::size_t size() const { return as_size(rows + 3) * stride + 16; }
  std::size_t at(int row, int col) const { return as_size(row + 1) * stride + as_size(col) + 16; }
  std::size_t lenslet(std::int32_t k) const { return at(k / cols, k % cols); }

  int rows;  ///< of lenslets
  int cols;
  std::size_t stride;
};

}  // namespace curlew
