// The rows of the tables FRAMES and VORTICES of results files.
#pragma once

#include <cstdint>
#include <vector>

#include "core/lenslet_grid.h"
#include "core/vortex.h"
#include "service/results/row_table.h"

namespace curlew {

std::vector<ColumnSpec> frame_columns();
std::vector<ColumnSpec> vortex_columns();

/// Appends a vortex to a table of vortex_columns().
void append_vortex(RowTable& table, std::int64_t frame, const Vortex& vortex,
                   const LensletGrid& grid);

/// Reads a row of vortex_columns() as append_vortex() wrote it.
class VortexRow {
 public:
  VortexRow();

  std::size_t bytes() const { return bytes_; }
  std::int64_t frame(const std::byte* row) const;
  Vortex vortex(const std::byte* row) const;

 private:
  std::size_t bytes_;
  std::size_t frame_, x_, y_, charge_, circulation_, significance_, flags_, track_, probability_,
      variance_x_, variance_y_, covariance_xy_, velocity_x_, velocity_y_;
};

}  // namespace curlew
