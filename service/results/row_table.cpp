#include "service/results/row_table.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <stdexcept>
#include <system_error>
#include <utility>

#include "acquisition/fits/partial_path.h"
#include "core/error.h"

namespace curlew {
namespace {

namespace fs = std::filesystem;

/// Opens a file that has no name, or none any more.
FileDescriptor open_nameless(const std::string& folder) {
  FileDescriptor file(open(folder.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600));
  if (file) return file;
  std::string name = folder + "/curlew-rows-XXXXXX";  // Not every file system knows O_TMPFILE.
  FileDescriptor named(mkostemp(name.data(), O_CLOEXEC));
  if (!named)
    throw Failure(folder + " cannot be written: " + std::generic_category().message(errno));
  unlink(name.c_str());
  return named;
}

}  // namespace

std::size_t cell_bytes(const ColumnSpec& column) {
  return column.format == 'K' || column.format == 'D' ? 8 : 4;
}

std::size_t row_bytes(std::span<const ColumnSpec> columns) {
  std::size_t bytes = 0;
  for (const ColumnSpec& column : columns) bytes += cell_bytes(column);
  return bytes;
}

std::size_t cell_offset(std::span<const ColumnSpec> columns, std::string_view name) {
  std::size_t offset = 0;
  for (const ColumnSpec& column : columns) {
    if (column.name == name) return offset;
    offset += cell_bytes(column);
  }
  throw std::logic_error("there is no column " + std::string(name));
}

RowTable::RowTable(std::string name, std::vector<ColumnSpec> columns, const std::string& beside)
    : name_(std::move(name)),
      columns_(std::move(columns)),
      row_bytes_(row_bytes(columns_)),
      folder_(fs::path(target_of(beside)).parent_path().string()) {}

RowTable::RowTable(std::string name, std::vector<ColumnSpec> columns, TakeRows take)
    : name_(std::move(name)),
      columns_(std::move(columns)),
      row_bytes_(row_bytes(columns_)),
      take_(std::move(take)) {}

void RowTable::flush() {
  if (take_) {
    take_(in_memory());
  } else {
    spill();
  }
  used_ = 0;
}

void RowTable::spill() {
  if (!spilled_) spilled_ = open_nameless(folder_);
  for (std::size_t done = 0; done < used_;) {
    const ssize_t n = ::write(spilled_.get(), bytes_.data() + done, used_ - done);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0)
      throw Failure(folder_ + " cannot be written: " + std::generic_category().message(errno));
    done += static_cast<std::size_t>(n);
  }
  spilled_bytes_ += static_cast<std::int64_t>(used_);
}

void RowTable::for_each_block(const TakeRows& take) const {
  std::vector<std::byte> block(spilled_ ? kInMemory_bytes / row_bytes_ * row_bytes_ : 0);
  for (std::int64_t at = 0; at < spilled_bytes_;) {
    const std::size_t wanted =
        std::min(block.size(), static_cast<std::size_t>(spilled_bytes_ - at));
    std::size_t got = 0;
    while (got < wanted) {
      const ssize_t n = pread(spilled_.get(), block.data() + got, wanted - got,
                              static_cast<off_t>(at + static_cast<std::int64_t>(got)));
      if (n < 0 && errno == EINTR) continue;
      if (n <= 0) throw Failure(folder_ + " cannot be read: rows that were written are gone");
      got += static_cast<std::size_t>(n);
    }
    take(std::span(block.data(), wanted));
    at += static_cast<std::int64_t>(wanted);
  }
  if (used_ > 0) take(in_memory());
}

void RowTable::write(FitsFile& file) const {
  file.create_table(name_, columns_);
  std::int64_t row = 0;
  for_each_block([&](std::span<const std::byte> rows) {
    file.write_rows(row, rows);
    row += static_cast<std::int64_t>(rows.size() / row_bytes_);
  });
}

}  // namespace curlew
