// This writes FITS by hand, for files that no library would write.
#pragma once

#include <string>
#include <vector>

namespace curlew {

/// Returns a header of these cards, each padded to 80 bytes, with END, padded to a FITS block.
inline std::string raw_header(const std::vector<std::string>& cards) {
  std::string text;
  for (std::string card : cards) {
    card.resize(80, ' ');
    text += card;
  }
  std::string end = "END";
  end.resize(80, ' ');
  text += end;
  text.resize((text.size() + 2879) / 2880 * 2880, ' ');
  return text;
}

/// Returns a header card of an integer or T.
inline std::string raw_card(const std::string& key, const std::string& value) {
  std::string card = key;
  card.resize(8, ' ');
  card += "= ";
  if (value.size() < 20) card.append(20 - value.size(), ' ');
  return card + value;
}

/// Returns the header of a primary image, with the fastest axis first.
inline std::string raw_image_header(int bitpix, const std::vector<std::string>& axes) {
  std::vector<std::string> cards{raw_card("SIMPLE", "T"),
                                 raw_card("BITPIX", std::to_string(bitpix)),
                                 raw_card("NAXIS", std::to_string(axes.size()))};
  for (std::size_t i = 0; i < axes.size(); ++i) {
    cards.push_back(raw_card("NAXIS" + std::to_string(i + 1), axes[i]));
  }
  return raw_header(cards);
}

}  // namespace curlew
