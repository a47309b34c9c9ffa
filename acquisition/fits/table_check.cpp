// This file checks what headers say of tables, of which compressed images are some.
#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "acquisition/fits/fits_card.h"
#include "acquisition/fits/header_check.h"
#include "acquisition/fits/header_layout.h"

namespace curlew {
namespace {

// Returns the bytes that a binary column takes in a row, or nullopt if `format` is none: a repeat
// count, a letter, and for some letters more.
std::optional<std::int64_t> binary_column_bytes(std::string_view format) {
  std::int64_t repeat = 1;
  const char* const end = format.data() + format.size();
  const auto [letter, error] = std::from_chars(format.data(), end, repeat);
  if (error == std::errc::result_out_of_range || repeat < 0 || repeat > kMaxInt || letter == end)
    return std::nullopt;
  if (error != std::errc()) repeat = 1;
  const std::string_view rest(letter + 1, static_cast<std::size_t>(end - letter - 1));
  switch (std::toupper(static_cast<unsigned char>(*letter))) {
    case 'A': {
      if (rest.starts_with(':')) return repeat;  // a convention on substrings
      // rAw: texts of w characters; cfitsio divides by w.
      std::int64_t width = 1;
      if (!rest.empty() && (std::from_chars(rest.data(), end, width).ec != std::errc() ||
                            width < 1 || width > std::max<std::int64_t>(repeat, 1)))
        return std::nullopt;
      return repeat;
    }
    case 'X':
      return (repeat + 7) / 8;
    case 'L':
    case 'B':
    case 'S':
      return repeat;
    case 'I':
    case 'U':
      return 2 * repeat;
    case 'J':
    case 'V':
    case 'E':
      return 4 * repeat;
    case 'K':
    case 'W':
    case 'D':
    case 'C':
      return 8 * repeat;
    case 'M':
      return 16 * repeat;
    case 'P':
    case 'Q':
      if (repeat > 1 || rest.empty()) return std::nullopt;
      return repeat * (*letter == 'P' ? 8 : 16);
    default:
      return std::nullopt;
  }
}

bool is_ascii_column(std::string_view format) {
  if (format.empty() || std::string_view("AIFED").find(format[0]) == std::string_view::npos)
    return false;
  int width = 0;
  const auto read = std::from_chars(format.data() + 1, format.data() + format.size(), width);
  return read.ec == std::errc() && width >= 1 && width <= 10000;
}

/// Holds the keys of a compressed image. Where a key is missing its value is -1.
struct Tiling {
  std::int64_t bitpix = -1;
  std::int64_t axes = -1;
  std::array<std::int64_t, kMaxCompressedAxes> length{-1, -1, -1, -1, -1, -1};
  std::array<std::int64_t, kMaxCompressedAxes> tile{-1, -1, -1, -1, -1, -1};
};

Tiling read_tiling(const RawHeader& header) {
  Tiling tiling;
  const auto set = [](std::int64_t& into, std::int64_t value) { into = into < 0 ? value : into; };
  for (std::size_t i = 0; i < header.size(); ++i) {
    const std::string_view name = card_name(header.card(i));
    const std::int64_t value = integer_of(card_value(header.card(i))).value_or(-1);
    if (name == "ZBITPIX") tiling.bitpix = std::abs(value);
    if (name == "ZNAXIS") set(tiling.axes, value);
    const int length = number_after(name, "ZNAXIS");
    if (length > 0 && length <= kMaxCompressedAxes)
      set(tiling.length.at(static_cast<std::size_t>(length - 1)), value);
    const int tile = number_after(name, "ZTILE");
    if (tile > 0 && tile <= kMaxCompressedAxes)
      set(tiling.tile.at(static_cast<std::size_t>(tile - 1)), value);
  }
  return tiling;
}

// The parameters of a compression are names and values of the same number.
HeaderFault check_parameters(const RawHeader& header) {
  std::array<bool, 100> is_block_size{};
  std::array<bool, 100> is_pixel_bytes{};
  for (std::size_t i = 0; i < header.size(); ++i) {
    const auto number = static_cast<std::size_t>(number_after(card_name(header.card(i)), "ZNAME"));
    if (number >= is_block_size.size()) return "it has too many keys ZNAME";
    const std::string_view name = card_value(header.card(i)).text;
    if (name == "BLOCKSIZE") is_block_size.at(number) = true;
    if (name == "BYTEPIX") is_pixel_bytes.at(number) = true;
  }
  for (std::size_t i = 0; i < header.size(); ++i) {
    const std::string_view card = header.card(i);
    const auto number = static_cast<std::size_t>(number_after(card_name(card), "ZVAL"));
    if (number == 0 || number >= is_block_size.size()) continue;
    const std::int64_t value = integer_of(card_value(card)).value_or(0);
    if (is_block_size.at(number) && (value < 1 || value > 1024))
      return wrong_card(card, "a number of pixels, as BLOCKSIZE");
    if (is_pixel_bytes.at(number) && value != 1 && value != 2 && value != 4 && value != 8)
      return wrong_card(card, "1, 2, 4 or 8, as BYTEPIX");
  }
  return std::nullopt;
}

bool is_compressed(const RawHeader& header) {
  for (std::size_t i = 0; i < header.size(); ++i)
    if (card_name(header.card(i)) == "ZIMAGE" && card_value(header.card(i)).integer == 1)
      return true;
  return false;
}

}  // namespace

HeaderFault check_columns(const RawHeader& header, const HeaderLayout& layout) {
  std::int64_t row_bytes = 0;
  std::vector<bool> seen(static_cast<std::size_t>(layout.columns) + 1);
  for (std::size_t i = 0; i < header.size(); ++i) {
    const std::string_view card = header.card(i);
    // In a text table this key is a text.
    if (layout.is_binary && number_after(loose_card_name(card), "TNULL") > 0) {
      const CardValue value = card_value(card);
      if (value.kind != CardKind::kNone && value.kind != CardKind::kInteger)
        return wrong_card(card, "a whole number");
    }
    const int column = number_after(card_name(card), "TFORM");
    if (column == 0 || column > layout.columns) continue;
    if (seen[static_cast<std::size_t>(column)])
      return std::string(card_name(card)) + " is there twice";
    seen[static_cast<std::size_t>(column)] = true;
    std::string_view format = card_value(card).text;
    format.remove_prefix(std::min(format.find_first_not_of(' '), format.size()));
    const auto bytes = layout.is_binary          ? binary_column_bytes(format)
                       : is_ascii_column(format) ? std::optional<std::int64_t>(0)
                                                 : std::nullopt;
    if (!bytes) return wrong_card(card, "the format of a column");
    row_bytes += *bytes;
  }
  if (std::count(seen.begin(), seen.end(), true) != layout.columns)
    return "a column has no key TFORM";
  if (layout.is_binary && row_bytes != layout.axes[0])
    return "NAXIS1 is " + std::to_string(layout.axes[0]) + ", and the columns of a row take " +
           std::to_string(row_bytes) + " bytes";
  return std::nullopt;
}

HeaderFault check_compression(const RawHeader& header, const HeaderLayout& layout) {
  if (!is_compressed(header)) return std::nullopt;
  const std::string method = header.text("ZCMPTYPE");
  constexpr auto kMethods = std::to_array<std::string_view>(
      {"RICE_1", "RICE_ONE", "GZIP_1", "GZIP_2", "PLIO_1", "HCOMPRESS_1", "NOCOMPRESS"});
  if (std::find(kMethods.begin(), kMethods.end(), method) == kMethods.end())
    return "ZCMPTYPE names no way of compression that is known";
  const Tiling tiling = read_tiling(header);
  if (tiling.bitpix < 0) return "the key ZBITPIX is missing";
  if (tiling.axes < 1) return "the key ZNAXIS is missing or 0";
  std::int64_t tiles = 1;
  std::int64_t tile_pixels = 1;
  for (std::size_t i = 0; i < static_cast<std::size_t>(tiling.axes); ++i) {
    const std::int64_t length = tiling.length[i];
    if (length < 0) return "the key ZNAXIS" + std::to_string(i + 1) + " is missing";
    // Without the key, a tile is a row of the image.
    const std::int64_t tile = tiling.tile[i] > 0 ? tiling.tile[i] : i == 0 ? length : 1;
    if (tile == 0 || __builtin_mul_overflow(tile_pixels, std::min(tile, length), &tile_pixels) ||
        __builtin_mul_overflow(tiles, (length + tile - 1) / tile, &tiles))
      return "its tiles make no sense";
  }
  if (tile_pixels > kMaxInt / 8) return "one of its tiles has more pixels than can be unpacked";
  if (tiles > layout.axes[1])
    return "its image has " + std::to_string(tiles) + " tiles, and the table has rows for " +
           std::to_string(layout.axes[1]);
  return check_parameters(header);
}

}  // namespace curlew
