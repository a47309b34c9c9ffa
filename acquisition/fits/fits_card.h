// This reads single header cards by our own code. What cfitsio makes of a value that it does not
// expect overruns its buffers.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

namespace curlew {

/// Says what a card's value looks like. kNone: the card has none. kOther: it is nothing that FITS
/// knows, or a number that no double holds.
enum class CardKind { kNone, kLogical, kInteger, kReal, kText, kOther };

struct CardValue {
  CardKind kind = CardKind::kNone;
  std::int64_t integer = 0;  ///< of an integer; 1 for T and 0 for F
  double real = 0.0;         ///< of an integer or a real number, always finite
  std::string_view text{};   ///< what stands between the quotes, without blanks at its end

  bool is_number() const { return kind == CardKind::kInteger || kind == CardKind::kReal; }
};

/// Returns the keyword of a card, without the blanks behind it. card: up to 80 characters.
std::string_view card_name(std::string_view card);

/// Returns the keyword that cfitsio takes a card for: it ends at the first blank or equals sign,
/// and after HIERARCH and a blank comes the keyword that counts, whatever its length.
std::string_view loose_card_name(std::string_view card);

/// Returns the value of a card. The value ends at the first blank or slash outside quotes.
CardValue card_value(std::string_view card);

/// These return the value as a number; text in quotes counts if it is a number, as it does for
/// cfitsio. They return nullopt if the value is no number or, for an integer, not a whole one.
std::optional<double> real_of(const CardValue& value);
std::optional<std::int64_t> integer_of(const CardValue& value);

}  // namespace curlew
