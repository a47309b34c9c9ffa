#include "acquisition/recording/frame_selection.h"

#include <array>
#include <charconv>
#include <limits>
#include <string_view>

#include "core/error.h"

namespace curlew {
namespace {

constexpr int kMost = std::numeric_limits<int>::max();

// Takes a number off the front of the text, and then the separator. Blanks do not count.
bool take_number(std::string_view& text, int& value, std::string_view separator) {
  const auto skip_blanks = [&text] {
    while (text.starts_with(' ')) text.remove_prefix(1);
  };
  skip_blanks();
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc()) return false;
  text.remove_prefix(static_cast<std::size_t>(end - text.data()));
  skip_blanks();
  if (!text.starts_with(separator)) return false;
  text.remove_prefix(separator.size());
  return true;
}

// Says whether the region has pixels, and ends before an int does.
bool makes_sense(const PixelRegion& region) {
  return region.x >= 0 && region.y >= 0 && region.width > 0 && region.height > 0 &&
         region.x <= kMost - region.width && region.y <= kMost - region.height;
}

}  // namespace

std::optional<PixelRegion> parse_region(const std::string& text) {
  if (text.empty()) return std::nullopt;
  std::string_view rest = text;
  PixelRegion region;
  const bool numbers = take_number(rest, region.x, ",") && take_number(rest, region.y, ",") &&
                       take_number(rest, region.width, ",") && take_number(rest, region.height, "");
  if (!numbers || !rest.empty() || !makes_sense(region)) {
    throw UsageError("a region is X,Y,W,H (first column and row from 0, width and height), not " +
                     text);
  }
  return region;
}

std::optional<PixelRegion> parse_section(const std::string& text) {
  std::string_view rest = text;
  while (rest.starts_with(' ')) rest.remove_prefix(1);
  if (!rest.starts_with('[')) return std::nullopt;
  rest.remove_prefix(1);
  std::array<int, 4> ends{};
  const bool numbers = take_number(rest, ends[0], ":") && take_number(rest, ends[1], ",") &&
                       take_number(rest, ends[2], ":") && take_number(rest, ends[3], "]");
  if (!numbers || ends[0] < 1 || ends[1] < ends[0] || ends[2] < 1 || ends[3] < ends[2])
    return std::nullopt;
  return PixelRegion{ends[0] - 1, ends[2] - 1, ends[1] - ends[0] + 1, ends[3] - ends[2] + 1};
}

std::string region_text(const PixelRegion& region) {
  return "columns " + std::to_string(region.x) + " to " +
         std::to_string(region.x + region.width - 1) + " and rows " + std::to_string(region.y) +
         " to " + std::to_string(region.y + region.height - 1);
}

}  // namespace curlew
