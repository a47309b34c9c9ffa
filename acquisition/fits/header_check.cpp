#include "acquisition/fits/header_check.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>

#include "acquisition/fits/fits_card.h"
#include "acquisition/fits/header_layout.h"

namespace curlew {
namespace {

constexpr std::int64_t kMaxColumns = 999;
constexpr std::int64_t kMaxBytes = std::int64_t{1} << 62;
constexpr std::int64_t kAnyInteger = std::numeric_limits<std::int64_t>::max();
constexpr std::array<std::int64_t, 6> kBitpix{8, 16, 32, 64, -32, -64};

/// Says what the value of a key must be. It may be missing in all of them.
enum class Wanted { kInteger, kNumber, kLogical, kText, kBits };

struct Rule {
  std::string_view name;
  bool numbered = false;  ///< a number follows the name
  Wanted wanted = Wanted::kInteger;
  std::int64_t low = -kAnyInteger;
  std::int64_t high = kAnyInteger;
};

constexpr auto kRules = std::to_array<Rule>({
    {"SIMPLE", false, Wanted::kLogical},
    {"EXTEND", false, Wanted::kLogical},
    {"XTENSION", false, Wanted::kText},
    {"BITPIX", false, Wanted::kBits},
    {"NAXIS", false, Wanted::kInteger, 0, kMaxAxes},
    {"NAXIS", true, Wanted::kInteger, 0},
    {"PCOUNT", false, Wanted::kInteger, 0},
    {"GCOUNT", false, Wanted::kInteger, 0},
    {"BSCALE", false, Wanted::kNumber},
    {"BZERO", false, Wanted::kNumber},
    {"BLANK", false, Wanted::kInteger},
    {"TFIELDS", false, Wanted::kInteger, 0, kMaxColumns},
    {"THEAP", false, Wanted::kInteger, 0},
    {"TFORM", true, Wanted::kText},
    {"TBCOL", true, Wanted::kInteger, 1, kMaxInt},
    {"TSCAL", true, Wanted::kNumber},
    {"TZERO", true, Wanted::kNumber},
    {"ZIMAGE", false, Wanted::kLogical},
    {"ZSIMPLE", false, Wanted::kLogical},
    {"ZEXTEND", false, Wanted::kLogical},
    {"ZBITPIX", false, Wanted::kBits},
    {"ZNAXIS", false, Wanted::kInteger, 0, kMaxCompressedAxes},
    {"ZNAXIS", true, Wanted::kInteger, 0, kMaxInt},
    {"ZTILE", true, Wanted::kInteger, 1, kMaxInt},
    {"ZPCOUNT", false, Wanted::kInteger, 0},
    {"ZGCOUNT", false, Wanted::kInteger, 0},
    {"ZCMPTYPE", false, Wanted::kText},
    {"ZNAME", true, Wanted::kText},
    {"ZVAL", true, Wanted::kNumber},
    {"ZSCALE", false, Wanted::kNumber},
    {"ZZERO", false, Wanted::kNumber},
    {"ZBLANK", false, Wanted::kInteger},
    {"ZDITHER0", false, Wanted::kInteger, 0, 10000},
});

// Returns the value of a card for a message, without anything that a terminal would obey.
std::string shown_value(std::string_view card) {
  std::string text(card.substr(std::min<std::size_t>(10, card.size())));
  text.erase(0, std::min(text.find_first_not_of(' '), text.size()));
  if (!text.starts_with('\'')) text.resize(std::min(text.find('/'), text.size()));
  text.resize(std::min<std::size_t>(text.find_last_not_of(' ') + 1, 24));
  for (char& c : text)
    if (c < ' ' || c > '~') c = '?';
  return text;
}

std::string range_text(const Rule& rule) {
  if (rule.low == -kAnyInteger) return "a whole number";
  if (rule.high >= kMaxInt) return "a whole number from " + std::to_string(rule.low) + " on";
  return "a whole number from " + std::to_string(rule.low) + " to " + std::to_string(rule.high);
}

bool is_bitpix(std::int64_t value) {
  return std::find(kBitpix.begin(), kBitpix.end(), value) != kBitpix.end();
}

HeaderFault find_fault(const Rule& rule, std::string_view card) {
  const CardValue value = card_value(card);
  if (value.kind == CardKind::kNone) return std::nullopt;
  switch (rule.wanted) {
    case Wanted::kLogical:
      if (value.kind != CardKind::kLogical) return wrong_card(card, "T or F");
      break;
    case Wanted::kText:
      if (value.kind != CardKind::kText) return wrong_card(card, "a text in quotes");
      break;
    case Wanted::kNumber:
      if (value.kind == CardKind::kLogical || !real_of(value)) return wrong_card(card, "a number");
      break;
    case Wanted::kBits:
      if (value.kind != CardKind::kInteger || !is_bitpix(value.integer))
        return wrong_card(card, "8, 16, 32, 64, -32 or -64");
      break;
    case Wanted::kInteger: {
      const auto number = value.kind == CardKind::kText ? std::nullopt : integer_of(value);
      if (!number || *number < rule.low || *number > rule.high)
        return wrong_card(card, range_text(rule));
      break;
    }
  }
  return std::nullopt;
}

HeaderFault check_every_card(const RawHeader& header) {
  for (std::size_t i = 0; i < header.size(); ++i) {
    const std::string_view card = header.card(i);
    const std::string_view name = loose_card_name(card);
    for (const Rule& rule : kRules) {
      if (rule.numbered ? number_after(name, rule.name) == 0 : name != rule.name) continue;
      if (name != card_name(card) &&
          (card.starts_with("HIERARCH") || card_value(card).kind != CardKind::kNone))
        return "a card of the name " + std::string(name) + " is misspelt";
      if (HeaderFault fault = find_fault(rule, card)) return fault;
    }
  }
  return std::nullopt;
}

// Takes the next card, which must have this name and an integer.
std::optional<std::int64_t> take(const RawHeader& header, std::size_t& next,
                                 const std::string& name) {
  const std::string_view card = header.card(next);
  if (card_name(card) != name) return std::nullopt;
  ++next;
  const CardValue value = card_value(card);
  return value.kind == CardKind::kNone ? std::nullopt : integer_of(value);
}

HeaderFault read_layout(const RawHeader& header, HeaderLayout& layout) {
  const auto missing = [](const std::string& name) {
    return "the key " + name + " is not in its place";
  };
  const std::string_view kind = card_value(header.card(0)).text;
  layout.is_binary = kind == "BINTABLE" || kind == "A3DTABLE" || kind == "3DTABLE";
  layout.is_table = layout.is_binary || kind == "TABLE";
  std::size_t next = 1;
  const auto bitpix = take(header, next, "BITPIX");
  if (!bitpix) return missing("BITPIX");
  layout.element_bytes = std::abs(*bitpix) / 8;
  const auto naxis = take(header, next, "NAXIS");
  if (!naxis) return missing("NAXIS");
  for (std::int64_t i = 1; i <= *naxis; ++i) {
    const std::string name = "NAXIS" + std::to_string(i);
    const auto length = take(header, next, name);
    if (!length) return missing(name);
    layout.axes.push_back(*length);
  }
  if (!layout.is_table) return std::nullopt;
  if (*naxis != 2 || *bitpix != 8) return "a table must have BITPIX 8 and NAXIS 2";
  for (const char* const name : {"PCOUNT", "GCOUNT"})
    if (!take(header, next, name)) return missing(name);
  const auto columns = take(header, next, "TFIELDS");
  if (!columns) return missing("TFIELDS");
  layout.columns = *columns;
  return std::nullopt;
}

HeaderFault check_size(const RawHeader& header, const HeaderLayout& layout) {
  // The largest of each name counts, whichever cfitsio takes.
  std::int64_t parameters = 0;
  std::int64_t groups = 1;
  for (std::size_t i = 0; i < header.size(); ++i) {
    const std::int64_t value = integer_of(card_value(header.card(i))).value_or(0);
    if (card_name(header.card(i)) == "PCOUNT") parameters = std::max(parameters, value);
    if (card_name(header.card(i)) == "GCOUNT") groups = std::max(groups, value);
  }
  std::int64_t elements = layout.axes.empty() ? 0 : 1;
  bool overflows = false;
  const auto times = [&](std::int64_t factor) {
    overflows = overflows || __builtin_mul_overflow(elements, factor, &elements);
  };
  // In random groups, the first axis is 0 and does not count.
  for (std::size_t i = 0; i < layout.axes.size(); ++i)
    if (i > 0 || layout.axes[0] > 0 || layout.axes.size() == 1) times(layout.axes[i]);
  overflows = overflows || __builtin_add_overflow(elements, parameters, &elements);
  times(groups);
  times(layout.element_bytes);
  if (!overflows && elements <= kMaxBytes) return std::nullopt;
  return "it promises more than any file can hold";
}

}  // namespace

// Returns the number at the end of a name like NAXIS2, or 0 if `name` is not `root` and a number.
int number_after(std::string_view name, std::string_view root) {
  if (!name.starts_with(root) || name.size() == root.size()) return 0;
  int number = 0;
  const char* const end = name.data() + name.size();
  const auto read = std::from_chars(name.data() + root.size(), end, number);
  return read.ec == std::errc() && read.ptr == end && number > 0 ? number : 0;
}

std::string wrong_card(std::string_view card, const std::string& wanted) {
  return std::string(card_name(card)) + " is " + shown_value(card) + ", and must be " + wanted;
}

std::optional<std::string> find_header_fault(const RawHeader& header) {
  if (HeaderFault fault = check_every_card(header)) return fault;
  HeaderLayout layout;
  if (HeaderFault fault = read_layout(header, layout)) return fault;
  if (HeaderFault fault = check_size(header, layout)) return fault;
  if (!layout.is_table) return std::nullopt;
  if (HeaderFault fault = check_columns(header, layout)) return fault;
  return layout.is_binary ? check_compression(header, layout) : std::nullopt;
}

}  // namespace curlew
