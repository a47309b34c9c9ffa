// This file holds what FitsFile does with records, tables of one row whose cells may be texts and
// lists.
#include <fitsio.h>

#include <algorithm>
#include <limits>
#include <string>
#include <vector>

#include "acquisition/fits/fits_file.h"
#include "acquisition/fits/fits_handle.h"

namespace curlew {
namespace {

std::string format_of(const RecordField& field) {
  switch (field.kind) {
    case RecordKind::kText: {
      const auto* text = std::get_if<std::string>(&field.value);
      return std::to_string(std::max<std::size_t>(text != nullptr ? text->size() : 0, 1)) + "A";
    }
    case RecordKind::kInteger:
      return "K";
    case RecordKind::kReal:
      return "D";
    case RecordKind::kList:
      return "QD(0)";  // cfitsio counts the longest list when it closes the file
  }
  return "D";
}

void write_cell(fitsfile* file, int column, const RecordField& field, int* status) {
  if (const auto* text = std::get_if<std::string>(&field.value)) {
    std::string copy = *text;
    char* pointer = copy.data();
    fits_write_col(file, TSTRING, column, 1, 1, 1, &pointer, status);
  } else if (const auto* list = std::get_if<std::vector<double>>(&field.value)) {
    std::vector<double> copy = *list;
    if (!copy.empty())
      fits_write_col(file, TDOUBLE, column, 1, 1, static_cast<LONGLONG>(copy.size()), copy.data(),
                     status);
  } else if (field.kind == RecordKind::kInteger) {
    const auto* known = std::get_if<std::int64_t>(&field.value);
    LONGLONG number = known != nullptr ? *known : kNoInteger;
    fits_write_col(file, TLONGLONG, column, 1, 1, 1, &number, status);
  } else if (field.kind == RecordKind::kReal) {
    const auto* known = std::get_if<double>(&field.value);
    double number = known != nullptr ? *known : std::numeric_limits<double>::quiet_NaN();
    fits_write_col(file, TDOUBLE, column, 1, 1, 1, &number, status);
  }
}

}  // namespace

void FitsFile::create_record(const std::string& name, std::span<const RecordField> fields,
                             bool with_row) {
  auto* file = static_cast<fitsfile*>(handle_->file);
  std::vector<std::string> texts;
  for (const RecordField& field : fields)
    for (const std::string& text : {field.name, format_of(field), field.unit})
      texts.push_back(text);
  std::vector<char*> names;
  std::vector<char*> formats;
  std::vector<char*> units;
  for (std::size_t i = 0; i < texts.size(); i += 3) {
    names.push_back(texts[i].data());
    formats.push_back(texts[i + 1].data());
    units.push_back(texts[i + 2].data());
  }
  int status = 0;
  fits_create_tbl(file, BINARY_TBL, with_row ? 1 : 0, static_cast<int>(fields.size()), names.data(),
                  formats.data(), units.data(), name.c_str(), &status);
  for (std::size_t i = 0; i < fields.size() && status == 0; ++i) {
    const int column = static_cast<int>(i) + 1;
    if (fields[i].kind == RecordKind::kInteger) {
      LONGLONG none = kNoInteger;
      fits_write_key(file, TLONGLONG, ("TNULL" + std::to_string(column)).c_str(), &none,
                     "stands for no value", &status);
      fits_set_btblnull(file, column, none, &status);
    }
    if (with_row) write_cell(file, column, fields[i], &status);
  }
  handle_->check(status, "add the table " + name);
}

}  // namespace curlew
