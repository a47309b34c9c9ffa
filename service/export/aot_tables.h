// AotTables are the tables of AOT, the exchange format of adaptive-optics telemetry, version 2.0.0.
#pragma once

#include <map>
#include <span>
#include <string>
#include <vector>

#include "acquisition/fits/fits_file.h"

namespace curlew {

/// The cells of a table's only row, by the names of its columns. Columns that are not named have no
/// value.
using AotRow = std::map<std::string, decltype(RecordField::value)>;

/// Appends the table to the file with all of its columns, in the order and with the units of the
/// format. Without a row it is there all the same, as mandatory tables have to be.
void write_aot_table(FitsFile& file, const std::string& name, const AotRow& row = {});

/// "INTREF<NAME>": a reference to an image of the same file.
std::string image_reference(const std::string& name);
/// "ROWREF<uid>": a reference to a row of another table.
std::string row_reference(const std::string& uid);

}  // namespace curlew
