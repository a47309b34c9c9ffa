// An Assignment pairs the members of two small sets one to one, of which only few pairs are
// possible.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace curlew {

/// Finds the assignment of greatest total gain by shortest augmenting paths with prices (R. Jonker
/// and A. Volgenant, Computing 38, 325, 1987). It looks only at the pairs that were allowed, so a
/// path never leaves the cluster of rows and columns in which it begins. A row or column for which
/// no pair is worth its gain stays free. Nothing is allocated after the constructor.
class Assignment {
 public:
  /// max_rows, max_cols: the most that clear() may ask for. pairs_per_row: the most pairs that a
  /// row keeps; if more are allowed, those of least gain are left out.
  Assignment(std::size_t max_rows, std::size_t max_cols, std::size_t pairs_per_row);

  /// Forgets all pairs and begins a problem of `rows` × `cols`, at most those of the constructor.
  void clear(std::size_t rows, std::size_t cols) noexcept;
  /// Allows the pair (row, col) to be assigned. A pair whose gain is not above 0 is ignored.
  void allow(std::size_t row, std::size_t col, float gain) noexcept;
  /// Finds the best assignment of the pairs allowed since clear().
  void solve() noexcept;

  /// Returns the column of each row after solve(), −1 for a free row.
  std::span<const std::int32_t> col_of_row() const { return {col_of_row_.data(), rows_}; }
  /// Returns the row of each column after solve(), −1 for a free column.
  std::span<const std::int32_t> row_of_col() const { return {row_of_col_.data(), cols_}; }

 private:
  struct Pair {
    std::int32_t col = 0;
    float gain = 0;
  };
  void place(std::size_t first) noexcept;

  std::size_t pairs_per_row_;
  std::size_t rows_ = 0;
  std::size_t cols_ = 0;
  std::vector<Pair> pairs_;               // [max rows, pairs_per_row]
  std::vector<std::int32_t> pair_count_;  // [max rows]
  std::vector<std::int32_t> col_of_row_;  // [max rows]
  std::vector<std::int32_t> row_of_col_;  // [max cols]
  std::vector<float> price_;              // [max cols]
  // The search from one row uses the following. For each column, cost_ is what it costs to reach
  // it, reached_from_ is the row before it on the path, and settled_ says whether its cost is
  // final. reached_ lists the columns in the order in which they were reached.
  std::vector<float> cost_;
  std::vector<std::int32_t> reached_from_;
  std::vector<std::uint8_t> settled_;
  std::vector<std::int32_t> reached_;
};

}  // namespace curlew
