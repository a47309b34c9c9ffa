// The best one-to-one assignment between two small sets, few pairs of which are possible.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace curlew {

/// Solves for the greatest total gain, by shortest augmenting paths with prices (R. Jonker and
/// A. Volgenant, Computing 38, 325, 1987) over the pairs that are possible alone: a path never
/// leaves the cluster it begins in. Whoever gains nothing stays free.
class Assignment {
 public:
  /// pairs_per_row: of more, those of least gain are left out.
  Assignment(std::size_t max_rows, std::size_t max_cols, std::size_t pairs_per_row);

  /// Begins anew with so many, at most those of the constructor.
  void clear(std::size_t rows, std::size_t cols) noexcept;
  /// A pair that may be assigned. Only what gains more than 0 counts.
  void allow(std::size_t row, std::size_t col, float gain) noexcept;
  void solve() noexcept;

  /// After solve(): the column of each row, −1 where it is free.
  std::span<const std::int32_t> col_of_row() const { return {col_of_row_.data(), rows_}; }
  /// After solve(): the row of each column, −1 where it is free.
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
  std::vector<std::int32_t> col_of_row_;
  std::vector<std::int32_t> row_of_col_;
  std::vector<float> price_;  // of a column
  // Of the search from one row: what reaching each column costs, from which row, in which order.
  std::vector<float> cost_;
  std::vector<std::int32_t> reached_from_;
  std::vector<std::uint8_t> settled_;
  std::vector<std::int32_t> reached_;
};

}  // namespace curlew
