// This checks FITS headers before cfitsio reads them.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace curlew {

/// Holds the cards of one header, as they are in the file.
struct RawHeader {
  enum class End {
    kNone,      ///< no header begins there
    kMissing,   ///< the file ends before the header does
    kComplete,  ///< the card END is there
    kTooLong    ///< END is further away than any header is long
  };
  std::string cards{};  ///< all cards before END, 80 characters each
  End end = End::kNone;

  std::size_t size() const { return cards.size() / kCard; }
  /// Returns card i, or nothing if there are fewer.
  std::string_view card(std::size_t i) const {
    return i < size() ? std::string_view(cards).substr(i * kCard, kCard) : std::string_view();
  }
  /// Returns the text of the first key of this name, in capitals; empty if there is none.
  std::string text(std::string_view name) const;

  static constexpr std::size_t kCard = 80;
};

inline constexpr int kMaxAxes = 9;  ///< of an image, for cfitsio

/// Reads the header that begins at `offset` in an open file: SIMPLE at 0, XTENSION anywhere else.
/// It leaves the file's own position alone.
RawHeader read_raw_header(int file, std::int64_t offset);

/// Returns what is wrong with a complete header, in a phrase that follows "the header is damaged:
/// "; nothing if it may be read.
///
/// Where cfitsio trusts a key, the key must be sane: the mandatory ones are in their places, NAXIS
/// is at most 9, no size is negative or more than any file can hold, every format of a column is
/// one, and keys that are read as numbers are numbers. A compressed image has sizes, tiles and
/// parameters by which one can divide. Every card of such a name is checked, doubles too. Keys that
/// mean nothing to cfitsio may hold anything.
std::optional<std::string> find_header_fault(const RawHeader& header);

}  // namespace curlew
