// This file holds what FitsFile does with binary tables.
#include <fitsio.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <string>
#include <type_traits>
#include <vector>

#include "acquisition/fits/fits_file.h"
#include "acquisition/fits/fits_handle.h"
#include "acquisition/fits/hdu_bytes.h"

namespace curlew {
namespace {

// Returns the column's number, or 0 if there is none. Case does not matter. cfitsio takes '*', '?'
// and '#' in a name as wildcards; no name that the program asks for has them.
int find_column(fitsfile* file, const std::string& name) {
  int status = 0;
  int column = 0;
  std::string mutable_name = name;  // cfitsio's parameter is not const.
  fits_get_colnum(file, CASEINSEN, mutable_name.data(), &column, &status);
  fits_clear_errmsg();
  return status == 0 ? column : 0;
}

}  // namespace

void FitsFile::create_table(const std::string& name, std::span<const ColumnSpec> columns) {
  std::vector<std::string> names;
  std::vector<std::string> formats;
  std::vector<std::string> units;
  for (const ColumnSpec& column : columns) {
    names.push_back(column.name);
    formats.emplace_back(1, column.format);
    units.push_back(column.unit);
  }
  const auto pointers = [](std::vector<std::string>& texts) {
    std::vector<char*> list;
    list.reserve(texts.size());
    for (std::string& text : texts) list.push_back(text.data());
    return list;
  };
  std::vector<char*> name_list = pointers(names);
  std::vector<char*> format_list = pointers(formats);
  std::vector<char*> unit_list = pointers(units);
  int status = 0;
  fits_create_tbl(cfits(handle_->file), BINARY_TBL, 0, static_cast<int>(columns.size()),
                  name_list.data(), format_list.data(), unit_list.data(), name.c_str(), &status);
  handle_->check(status, "add the table " + name);
}

std::int64_t FitsFile::whole_row_count() {
  if (is_image()) return 0;
  fitsfile* file = cfits(handle_->file);
  int status = 0;
  LONGLONG rows = 0;
  fits_get_num_rowsll(file, &rows, &status);
  handle_->check(status, "count the rows of a table");
  if (handle_->writing()) return rows;
  LONGLONG head = 0;
  LONGLONG data = 0;
  LONGLONG end = 0;
  fits_get_hduaddrll(file, &head, &data, &end, &status);
  handle_->check(status, "find a table");
  // cfitsio cannot read a part of a FITS block.
  const std::int64_t present =
      std::max<std::int64_t>(0, (file->Fptr->filesize - data) / kFitsBlock * kFitsBlock);
  const std::int64_t row_bytes = std::max<std::int64_t>(1, file->Fptr->rowlength);
  return std::min<std::int64_t>(rows, present / row_bytes);
}

std::int64_t FitsFile::row_count() {
  int status = 0;
  LONGLONG rows = 0;
  if (is_image()) handle_->fail("has an image where a table is needed");
  fits_get_num_rowsll(cfits(handle_->file), &rows, &status);
  handle_->check(status, "count the rows of a table");
  if (const std::int64_t present = whole_row_count(); present < rows) {
    handle_->fail("is truncated: a table of " + std::to_string(rows) + " rows holds " +
                  std::to_string(present) + " whole ones");
  }
  return rows;
}

bool FitsFile::has_column(const std::string& name) {
  return !is_image() && find_column(cfits(handle_->file), name) != 0;
}

template <typename T>
void FitsFile::write_column(const std::string& name, std::int64_t first_row,
                            std::span<const T> values) {
  if (values.empty()) return;
  fitsfile* file = cfits(handle_->file);
  const int column = find_column(file, name);
  if (column == 0) handle_->fail("has no column " + name);
  int status = 0;
  // cfitsio's parameter is not const, but it does not write to it.
  fits_write_col(file, fits_datatype<T>(), column, first_row + 1, 1,
                 static_cast<LONGLONG>(values.size()), const_cast<T*>(values.data()), &status);
  handle_->check(status, "write the column " + name);
}

void FitsFile::write_rows(std::int64_t first_row, std::span<const std::byte> rows) {
  if (rows.empty()) return;
  int status = 0;
  // cfitsio's parameter is not const, but it does not write to it.
  auto* bytes = const_cast<unsigned char*>(reinterpret_cast<const unsigned char*>(rows.data()));
  fits_write_tblbytes(cfits(handle_->file), first_row + 1, 1, static_cast<LONGLONG>(rows.size()),
                      bytes, &status);
  handle_->check(status, "write the rows of a table");
}

template <typename T>
void FitsFile::read_column(const std::string& name, std::int64_t first_row, std::span<T> into) {
  if (into.empty()) return;
  fitsfile* file = cfits(handle_->file);
  const int column = find_column(file, name);
  if (column == 0) handle_->fail("has no column " + name);
  int status = 0;
  int type = 0;
  LONGLONG repeat = 0;
  LONGLONG width = 0;
  fits_get_coltypell(file, column, &type, &repeat, &width, &status);
  handle_->check(status, "read the column " + name);
  const auto rows = static_cast<LONGLONG>(into.size());
  if constexpr (std::is_same_v<T, std::string>) {
    constexpr LONGLONG kLongest = 1 << 20;
    if (type != TSTRING || repeat > kLongest)
      handle_->fail("has a column " + name + " that is not text, or too long");
    std::string text(static_cast<std::size_t>(repeat) + 1, '\0');
    for (LONGLONG row = 0; row < rows; ++row) {
      char* target = text.data();
      fits_read_col_str(file, column, first_row + row + 1, 1, 1, nullptr, &target, nullptr,
                        &status);
      into[static_cast<std::size_t>(row)] = target;
    }
  } else {
    if (repeat != 1 || type == TSTRING || type < 0) {
      handle_->fail("has a column " + name + " that is not one number a row");
    }
    fits_read_col(file, fits_datatype<T>(), column, first_row + 1, 1, rows, nullptr, into.data(),
                  nullptr, &status);
  }
  handle_->check(status, "read the column " + name);
}

#define CURLEW_COLUMN(T)                                                                      \
  template void FitsFile::write_column(const std::string&, std::int64_t, std::span<const T>); \
  template void FitsFile::read_column(const std::string&, std::int64_t, std::span<T>);
CURLEW_COLUMN(std::int32_t)
CURLEW_COLUMN(std::int64_t)
CURLEW_COLUMN(float)
CURLEW_COLUMN(double)
#undef CURLEW_COLUMN
template void FitsFile::read_column(const std::string&, std::int64_t, std::span<std::string>);

}  // namespace curlew
