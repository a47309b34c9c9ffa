// The parts of the check of headers share this.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "acquisition/fits/header_check.h"

namespace curlew {

/// Says what is wrong; nothing if all is well.
using HeaderFault = std::optional<std::string>;

/// Holds the mandatory keys, with which every header begins.
struct HeaderLayout {
  bool is_table = false;   ///< binary or ASCII
  bool is_binary = false;  ///< a binary table
  std::int64_t element_bytes = 1;
  std::vector<std::int64_t> axes{};  ///< fastest first
  std::int64_t columns = 0;
};

constexpr std::int64_t kMaxCompressedAxes = 6;  // those that cfitsio has room for
constexpr std::int64_t kMaxInt = std::numeric_limits<std::int32_t>::max();

/// Returns the number at the end of a name like NAXIS2, or 0 if `name` is not `root` and a number.
int number_after(std::string_view name, std::string_view root);

/// Returns "NAXIS is 120, and must be <wanted>", without anything that a terminal would obey.
std::string wrong_card(std::string_view card, const std::string& wanted);

/// Checks the formats of a table's columns.
HeaderFault check_columns(const RawHeader& header, const HeaderLayout& layout);

/// Checks the keys of a compressed image; a header without ZIMAGE has none.
HeaderFault check_compression(const RawHeader& header, const HeaderLayout& layout);

}  // namespace curlew
