#include "acquisition/fits/hdu_bytes.h"

#include <sys/stat.h>

#include <algorithm>
#include <cstdlib>
#include <utility>

#include "acquisition/fits/fits_card.h"

namespace curlew {
namespace {

std::int64_t number_of(const RawHeader& header, const std::string& name) {
  for (std::size_t i = 0; i < header.size(); ++i)
    if (card_name(header.card(i)) == name)
      return integer_of(card_value(header.card(i))).value_or(0);
  return 0;
}

std::string slowest_axis(const RawHeader& header) {
  return "NAXIS" + std::to_string(number_of(header, "NAXIS"));
}

}  // namespace

std::string HduBytes::header_for(std::int64_t n_slices) const {
  // The value ends in column 30, as the standard wants it of mandatory keys.
  constexpr std::size_t kValue = 10, kValueEnd = 30;
  std::string cards = header.cards;
  const std::string axis = slowest_axis(header);
  for (std::size_t i = 0; i < header.size(); ++i) {
    if (card_name(header.card(i)) != axis) continue;
    std::string number = std::to_string(n_slices);
    number.insert(0, kValueEnd - kValue - number.size(), ' ');
    cards.replace(i * RawHeader::kCard + kValue, number.size(), number);
  }
  cards += "END";
  cards.resize(static_cast<std::size_t>(whole_blocks(static_cast<std::int64_t>(cards.size()))),
               ' ');
  return cards;
}

std::vector<HduBytes> find_hdu_bytes(int file) {
  std::vector<HduBytes> hdus;
  struct stat what {};
  if (fstat(file, &what) != 0) return hdus;
  for (std::int64_t at = 0; at < what.st_size;) {
    HduBytes hdu;
    hdu.header = read_raw_header(file, at);
    if (hdu.header.end != RawHeader::End::kComplete || find_header_fault(hdu.header)) break;
    hdu.name = hdu.header.text("EXTNAME");
    hdu.begin = at;
    const auto cards = static_cast<std::int64_t>(hdu.header.cards.size() + RawHeader::kCard);
    hdu.data = at + whole_blocks(cards);
    const std::int64_t axes = number_of(hdu.header, "NAXIS");
    if (axes > 0) {
      hdu.slices = number_of(hdu.header, slowest_axis(hdu.header));
      hdu.slice_bytes = std::abs(number_of(hdu.header, "BITPIX")) / 8;
      for (std::int64_t i = 1; i < axes; ++i)
        hdu.slice_bytes *= number_of(hdu.header, "NAXIS" + std::to_string(i));
    }
    hdu.end =
        hdu.data + whole_blocks(hdu.slices * hdu.slice_bytes + number_of(hdu.header, "PCOUNT"));
    if (hdu.end > what.st_size) break;
    at = hdu.end;
    hdus.push_back(std::move(hdu));
  }
  return hdus;
}

}  // namespace curlew
