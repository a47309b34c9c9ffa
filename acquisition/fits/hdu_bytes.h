// The HDUs of a FITS file as bytes, for copying their data without reading every value.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "acquisition/fits/header_check.h"

namespace curlew {

inline constexpr std::int64_t kFitsBlock = 2880;  ///< bytes; each part of a file is a multiple

/// Returns so many bytes, filled up to whole blocks.
constexpr std::int64_t whole_blocks(std::int64_t bytes) {
  return (bytes + kFitsBlock - 1) / kFitsBlock * kFitsBlock;
}

/// Where one HDU is in its file. Along its slowest axis, the last NAXISn, are the planes of an
/// image or the rows of a table.
struct HduBytes {
  std::string name;  ///< EXTNAME; empty for the primary
  RawHeader header;
  std::int64_t begin = 0;        ///< where the header begins
  std::int64_t data = 0;         ///< where the data begin
  std::int64_t end = 0;          ///< where the next HDU begins
  std::int64_t slices = 0;       ///< planes or rows; 0 without data
  std::int64_t slice_bytes = 0;  ///< of each

  /// Returns the header for as many slices, in whole blocks.
  std::string header_for(std::int64_t n_slices) const;
};

/// Returns the HDUs of an open file, without those behind the first that is damaged or cut off.
/// Tables must have no heap.
std::vector<HduBytes> find_hdu_bytes(int file);

}  // namespace curlew
