// MemoryTable: a table that grows row by row in memory and is written to a FITS file as a whole.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "acquisition/fits/fits_file.h"

namespace curlew {

class MemoryTable {
 public:
  /// The columns have the format K, J, D or E.
  MemoryTable(std::string name, std::vector<ColumnSpec> columns)
      : name_(std::move(name)), specs_(std::move(columns)) {
    for (const ColumnSpec& spec : specs_) columns_.push_back(empty_column(spec.format));
  }

  /// Appends one row: a number for each column, in their order.
  template <typename... Values>
  void append(Values... values) {
    std::size_t column = 0;
    (put(column++, values), ...);
  }
  /// Appends one number to one column.
  template <typename Value>
  void put(std::size_t column, Value value) {
    std::visit(
        [value]<typename T>(std::vector<T>& cells) { cells.push_back(static_cast<T>(value)); },
        columns_[column]);
  }

  /// Appends the table to the file as a new HDU.
  void write(FitsFile& file) const {
    file.create_table(name_, specs_);
    for (std::size_t i = 0; i < specs_.size(); ++i)
      std::visit(
          [&]<typename T>(const std::vector<T>& cells) {
            if (!cells.empty()) file.write_column<T>(specs_[i].name, 0, cells);
          },
          columns_[i]);
  }

 private:
  using Column = std::variant<std::vector<std::int64_t>, std::vector<std::int32_t>,
                              std::vector<double>, std::vector<float>>;
  static Column empty_column(char format) {
    switch (format) {
      case 'K':
        return std::vector<std::int64_t>{};
      case 'J':
        return std::vector<std::int32_t>{};
      case 'E':
        return std::vector<float>{};
      default:
        return std::vector<double>{};
    }
  }

  std::string name_;
  std::vector<ColumnSpec> specs_;
  std::vector<Column> columns_;
};

}  // namespace curlew
