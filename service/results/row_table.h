// RowTable: a table that grows row by row, as bytes in the order of FITS. Most of it is on disk, so
// that its memory does not grow with the night.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "acquisition/fits/file_descriptor.h"
#include "acquisition/fits/fits_file.h"

namespace curlew {

/// Returns how many bytes a cell of the column has. The format is K, J, D or E.
std::size_t cell_bytes(const ColumnSpec& column);
std::size_t row_bytes(std::span<const ColumnSpec> columns);
/// Returns where the column's cell begins in a row. Throws std::logic_error if there is no such
/// column.
std::size_t cell_offset(std::span<const ColumnSpec> columns, std::string_view name);

/// Write and read a number as FITS has it, the most significant byte first. T: std::int32_t,
/// std::int64_t, float, double.
template <typename T>
void put_cell(std::byte* cell, T value) noexcept {
  std::byte bytes[sizeof(T)];
  std::memcpy(bytes, &value, sizeof value);
  for (std::size_t i = 0; i < sizeof(T); ++i) cell[i] = bytes[sizeof(T) - 1 - i];
}
template <typename T>
T cell_value(const std::byte* cell) noexcept {
  std::byte bytes[sizeof(T)];
  for (std::size_t i = 0; i < sizeof(T); ++i) bytes[i] = cell[sizeof(T) - 1 - i];
  T value;
  std::memcpy(&value, bytes, sizeof value);
  return value;
}
static_assert(std::endian::native == std::endian::little);

class RowTable {
 public:
  /// Takes a block of whole rows.
  using TakeRows = std::function<void(std::span<const std::byte>)>;

  /// beside: the file beside which rows go to disk, in a file without a name.
  RowTable(std::string name, std::vector<ColumnSpec> columns, const std::string& beside);
  /// Makes a table that keeps no rows, but gives them to `take`, block by block; flush() gives the
  /// last.
  RowTable(std::string name, std::vector<ColumnSpec> columns, TakeRows take);

  /// Appends one row: a number for each column, in their order. Throws Failure when the disk is
  /// full.
  template <typename... Values>
  void append(Values... values) {
    (put(values), ...);
  }
  /// Appends the next number of a row.
  template <typename Value>
  void put(Value value) {
    if (next_column_ == 0) make_room();
    switch (columns_[next_column_].format) {
      case 'K':
        push(static_cast<std::int64_t>(value));
        break;
      case 'J':
        push(static_cast<std::int32_t>(value));
        break;
      case 'E':
        push(static_cast<float>(value));
        break;
      default:
        push(static_cast<double>(value));
    }
    if (++next_column_ < columns_.size()) return;
    next_column_ = 0;
    ++rows_;
    if (used_ >= kInMemory_bytes) flush();
  }
  /// Sends the rows in memory to where the others went.
  void flush();

  std::int64_t rows() const { return rows_; }
  /// Gives all rows that are kept, in their order.
  void for_each_block(const TakeRows& take) const;
  /// Appends the table to the file as a new HDU.
  void write(FitsFile& file) const;

 private:
  static constexpr std::size_t kInMemory_bytes = 1 << 19;

  template <typename T>
  void push(T value) {
    put_cell(bytes_.data() + used_, value);
    used_ += sizeof(T);
  }
  /// Makes room for one row.
  void make_room() {
    if (bytes_.size() < used_ + row_bytes_) bytes_.resize(2 * (used_ + row_bytes_));
  }
  std::span<const std::byte> in_memory() const { return {bytes_.data(), used_}; }
  void spill();

  std::string name_;
  std::vector<ColumnSpec> columns_;
  std::size_t row_bytes_;
  std::size_t next_column_ = 0;
  std::int64_t rows_ = 0;
  std::string folder_;
  TakeRows take_;                 ///< null: rows are kept
  std::vector<std::byte> bytes_;  ///< the last rows, and room for more
  std::size_t used_ = 0;          ///< bytes of those rows
  FileDescriptor spilled_;        ///< the rows before them; none while all fit in memory
  std::int64_t spilled_bytes_ = 0;
};

}  // namespace curlew
