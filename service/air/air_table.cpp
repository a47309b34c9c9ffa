#include "service/air/air_table.h"

#include <algorithm>
#include <cctype>
#include <limits>
#include <optional>

namespace curlew {
namespace {

std::string upper(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  return text;
}

}  // namespace

AirTable::AirTable(const Plan& plan, const AirOptions& options)
    : meter_(plan, options),
      whole_(plan, {std::numeric_limits<double>::infinity(), options.fresnel_pitches}),
      sample_(meter_.make_sample()) {}

std::optional<AirReport> AirTable::add(const FrameSlot& slot) {
  AirMeter::fill(slot, sample_);
  whole_.add(sample_, slot.frame_index);
  std::optional<AirReport> complete = meter_.add(sample_, slot.frame_index);
  if (complete) windows_.push_back(*complete);
  return complete;
}

MemoryTable AirTable::table() const {
  std::vector<AirReport> rows = windows_;
  rows.push_back(meter_.report());
  std::vector<ColumnSpec> columns{
      {"FIRST_FRAME", 'K', ""}, {"LAST_FRAME", 'K', ""}, {"SECONDS", 'D', "s"}};
  for (const AirEntry& entry : entries_of(rows.back())) {
    columns.push_back({upper(entry.name), 'D', ""});
    columns.push_back({"ERR_" + upper(entry.name), 'D', ""});
  }
  MemoryTable table("AIR", columns);
  for (const AirReport& row : rows) {
    if (row.figures.frames == 0) continue;
    std::size_t column = 0;
    table.put(column++, row.first_frame);
    table.put(column++, row.last_frame);
    table.put(column++, row.figures.seconds);
    for (const AirEntry& entry : entries_of(row)) {
      table.put(column++, entry.figure.value);
      table.put(column++, entry.figure.error);
    }
  }
  return table;
}

std::string AirTable::text() const { return air_text(whole_.report()); }

}  // namespace curlew
