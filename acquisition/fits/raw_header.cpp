// This file holds how the cards of a header are read from an open file.
#include <unistd.h>

#include <array>
#include <cerrno>

#include "acquisition/fits/fits_card.h"
#include "acquisition/fits/hdu_bytes.h"
#include "acquisition/fits/header_check.h"

namespace curlew {
namespace {

// Headers of telescopes have hundreds of cards, rarely thousands.
constexpr std::size_t kMostCards = 100'000;

// Reads one block; returns false if the file ends before the block does.
bool read_block(int file, std::int64_t offset, std::array<char, kFitsBlock>& block) {
  std::size_t got = 0;
  while (got < kFitsBlock) {
    const ssize_t n = pread(file, block.data() + got, kFitsBlock - got,
                            static_cast<off_t>(offset + static_cast<std::int64_t>(got)));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    got += static_cast<std::size_t>(n);
  }
  return true;
}

}  // namespace

std::string RawHeader::text(std::string_view name) const {
  for (std::size_t i = 0; i < size(); ++i)
    if (card_name(card(i)) == name) return std::string(card_value(card(i)).text);
  return {};
}

RawHeader read_raw_header(int file, std::int64_t offset) {
  RawHeader header;
  std::array<char, kFitsBlock> block{};
  const std::string_view text(block.data(), block.size());
  const std::string_view first = offset == 0 ? "SIMPLE" : "XTENSION";
  for (std::int64_t at = offset; header.size() < kMostCards;
       at += static_cast<std::int64_t>(kFitsBlock)) {
    if (!read_block(file, at, block)) return header;
    if (at == offset) {
      if (card_name(text.substr(0, RawHeader::kCard)) != first) return header;
      header.end = RawHeader::End::kMissing;
    }
    for (std::size_t i = 0; i < kFitsBlock; i += RawHeader::kCard) {
      if (card_name(text.substr(i, RawHeader::kCard)) == "END") {
        header.end = RawHeader::End::kComplete;
        return header;
      }
      header.cards += text.substr(i, RawHeader::kCard);
    }
  }
  header.end = RawHeader::End::kTooLong;
  return header;
}

}  // namespace curlew
