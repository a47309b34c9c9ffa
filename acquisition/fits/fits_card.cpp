#include "acquisition/fits/fits_card.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <string>

namespace curlew {
namespace {

constexpr std::size_t kNameLength = 8;
constexpr std::size_t kValueStart = 10;
constexpr std::size_t kLongestNumber = 40;  // characters

std::string_view trimmed(std::string_view text) {
  const std::size_t first = text.find_first_not_of(' ');
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(' ') - first + 1);
}

// Returns what stands between the quote at the beginning of `field` and the next single one.
std::string_view quoted(std::string_view field) {
  std::size_t end = 1;
  while (end < field.size()) {
    if (field[end] == '\'') {
      if (end + 1 >= field.size() || field[end + 1] != '\'') break;
      ++end;
    }
    ++end;
  }
  std::string_view text = field.substr(1, std::min(end, field.size()) - 1);
  while (!text.empty() && text.back() == ' ') text.remove_suffix(1);
  return text;
}

// Reads a number as FITS writes it: a sign, digits, a point, an exponent after E or D.
CardValue number_value(std::string_view token) {
  CardValue value{.kind = CardKind::kOther};
  if (!token.empty() && token.front() == '+') token.remove_prefix(1);
  if (token.empty() || token.size() > kLongestNumber) return value;
  // from_chars takes "inf" and "nan" as well.
  if (token.find_first_not_of("0123456789+-.eEdD") != std::string_view::npos) return value;
  const char* const end = token.data() + token.size();
  const auto whole = std::from_chars(token.data(), end, value.integer);
  if (whole.ec == std::errc() && whole.ptr == end) {
    value.kind = CardKind::kInteger;
    value.real = static_cast<double>(value.integer);
    return value;
  }
  std::string digits(token);
  std::replace_if(
      digits.begin(), digits.end(), [](char c) { return c == 'd' || c == 'D'; }, 'E');
  const char* const digits_end = digits.data() + digits.size();
  const auto real = std::from_chars(digits.data(), digits_end, value.real);
  if (real.ec == std::errc() && real.ptr == digits_end) value.kind = CardKind::kReal;
  return value;
}

}  // namespace

std::string_view card_name(std::string_view card) {
  std::string_view name = card.substr(0, std::min(kNameLength, card.size()));
  while (!name.empty() && name.back() == ' ') name.remove_suffix(1);
  return name;
}

std::string_view loose_card_name(std::string_view card) {
  constexpr std::string_view kLongNames = "HIERARCH ";
  if (card.starts_with(kLongNames)) {
    const std::string_view rest = card.substr(kLongNames.size());
    return trimmed(rest.substr(0, rest.find('=')));
  }
  const std::string_view name = card.substr(0, std::min(kNameLength, card.size()));
  return name.substr(0, name.find_first_of(" ="));
}

CardValue card_value(std::string_view card) {
  if (card.size() < kValueStart || card.substr(kNameLength, 2) != "= ") return {};
  std::string_view field = card.substr(kValueStart);
  const std::size_t first = field.find_first_not_of(' ');
  if (first == std::string_view::npos) return {};
  field.remove_prefix(first);
  if (field.front() == '\'') return {.kind = CardKind::kText, .text = quoted(field)};
  const std::string_view token = field.substr(0, field.find_first_of(" /"));
  if (token.empty()) return {};
  if (token == "T" || token == "F")
    return {.kind = CardKind::kLogical, .integer = token == "T" ? 1 : 0};
  return number_value(token);
}

std::optional<double> real_of(const CardValue& value) {
  if (value.is_number()) return value.real;
  if (value.kind == CardKind::kLogical) return static_cast<double>(value.integer);
  if (value.kind != CardKind::kText) return std::nullopt;
  const CardValue inner = number_value(trimmed(value.text));
  return inner.is_number() ? std::optional(inner.real) : std::nullopt;
}

std::optional<std::int64_t> integer_of(const CardValue& value) {
  if (value.kind == CardKind::kInteger || value.kind == CardKind::kLogical) return value.integer;
  if (value.kind == CardKind::kText) {
    const CardValue inner = number_value(trimmed(value.text));
    return inner.is_number() ? integer_of(inner) : std::nullopt;
  }
  constexpr double kBeyond = 9.2e18;
  if (value.kind != CardKind::kReal || value.real != std::floor(value.real) ||
      std::abs(value.real) > kBeyond)
    return std::nullopt;
  return static_cast<std::int64_t>(value.real);
}

}  // namespace curlew
