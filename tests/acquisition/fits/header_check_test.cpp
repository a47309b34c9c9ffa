// Whatever stands in a header, cfitsio sees only what it can bear.
#include "acquisition/fits/header_check.h"

#include <gtest/gtest.h>

#include <string>
#include <utility>
#include <vector>

#include "acquisition/fits/fits_card.h"
#include "acquisition/fits/fits_file.h"
#include "tests/support/failure_text.h"
#include "tests/support/raw_fits.h"
#include "tests/support/scratch_directory.h"

namespace curlew {
namespace {

using Cards = std::vector<std::string>;

RawHeader header_of(const Cards& cards) {
  RawHeader header{.end = RawHeader::End::kComplete};
  for (std::string card : cards) {
    card.resize(80, ' ');
    header.cards += card;
  }
  return header;
}

const Cards kImage{raw_card("SIMPLE", "T"), raw_card("BITPIX", "16"), raw_card("NAXIS", "2"),
                   raw_card("NAXIS1", "4"), raw_card("NAXIS2", "3")};

const Cards kCompressed{raw_card("XTENSION", "'BINTABLE'"),
                        raw_card("BITPIX", "8"),
                        raw_card("NAXIS", "2"),
                        raw_card("NAXIS1", "8"),
                        raw_card("NAXIS2", "48"),
                        raw_card("PCOUNT", "883"),
                        raw_card("GCOUNT", "1"),
                        raw_card("TFIELDS", "1"),
                        raw_card("TFORM1", "'1PB(27) '"),
                        raw_card("ZIMAGE", "T"),
                        raw_card("ZBITPIX", "16"),
                        raw_card("ZNAXIS", "3"),
                        raw_card("ZNAXIS1", "24"),
                        raw_card("ZNAXIS2", "24"),
                        raw_card("ZNAXIS3", "2"),
                        raw_card("ZTILE1", "24"),
                        raw_card("ZTILE2", "1"),
                        raw_card("ZTILE3", "1"),
                        raw_card("ZCMPTYPE", "'RICE_1  '"),
                        raw_card("ZNAME1", "'BLOCKSIZE'"),
                        raw_card("ZVAL1", "32"),
                        raw_card("ZNAME2", "'BYTEPIX '"),
                        raw_card("ZVAL2", "2")};

// Returns the cards with the one of this key replaced, or with a new one at their end.
Cards with(Cards cards, const std::string& key, const std::string& value) {
  for (std::string& card : cards) {
    if (card_name(card) != key) continue;
    card = raw_card(key, value);
    return cards;
  }
  cards.push_back(raw_card(key, value));
  return cards;
}

// Returns a text in quotes that is longer than the buffers of cfitsio have room for.
std::string long_text() {
  std::string text(62, 'a');
  text.front() = '\'';
  text.back() = '\'';
  return text;
}

std::string fault_of(const Cards& cards) {
  return find_header_fault(header_of(cards)).value_or("");
}

TEST(FitsCard, ValuesAreReadAsTheStandardSays) {
  EXPECT_EQ(integer_of(card_value("NAXIS   =                    3 / axes")), 3);
  EXPECT_EQ(integer_of(card_value("NAXIS   = +3")), 3);
  EXPECT_EQ(integer_of(card_value("N       = 2.0E1")), 20);
  EXPECT_EQ(integer_of(card_value("N       = 2.5")), std::nullopt);
  EXPECT_EQ(integer_of(card_value("N       = 99999999999999999999")), std::nullopt);
  EXPECT_EQ(real_of(card_value("X       = 1.5D-3/ old Fortran")), 1.5e-3);
  EXPECT_EQ(real_of(card_value("X       = '0.25  '")), 0.25);
  EXPECT_EQ(real_of(card_value("X       = nan")), std::nullopt);
  EXPECT_EQ(real_of(card_value("X       = 1E999")), std::nullopt);
  EXPECT_EQ(real_of(card_value("X       = 1.5x")), std::nullopt);
  EXPECT_EQ(card_value("T       = 'it''s   ' / text").text, "it''s");
  EXPECT_EQ(card_value("T       = 'not closed").text, "not closed");
  EXPECT_EQ(card_value("L       =                    T").kind, CardKind::kLogical);
  EXPECT_EQ(card_value("EMPTY   =                      / nothing").kind, CardKind::kNone);
  EXPECT_EQ(card_value("COMMENT  no value").kind, CardKind::kNone);
  EXPECT_EQ(card_value("SHORT").kind, CardKind::kNone);
}

TEST(HeaderCheck, WholeHeadersPass) {
  EXPECT_EQ(fault_of(kImage), "");
  EXPECT_EQ(fault_of(kCompressed), "");
  // What means nothing to cfitsio may hold anything.
  EXPECT_EQ(fault_of(with(kImage, "OBSERVER", long_text())), "");
  EXPECT_EQ(fault_of(with(kImage, "AIRMASS", "not a number at all")), "");
  EXPECT_EQ(fault_of(with(kImage, "BZERO", "32768.0")), "");
  // Random groups have a first axis of 0.
  EXPECT_EQ(fault_of(with(with(kImage, "NAXIS1", "0"), "GROUPS", "T")), "");
}

TEST(HeaderCheck, AKeyThatCfitsioTrustsIsSane) {
  const std::vector<std::pair<std::string, std::string>> wrong{
      {"NAXIS", "10"},           {"NAXIS", "120"},        {"NAXIS", "-1"},
      {"NAXIS", "'2'"},          {"NAXIS1", "-4"},        {"NAXIS2", long_text()},
      {"BITPIX", "7"},           {"BITPIX", "0"},         {"PCOUNT", "-1"},
      {"GCOUNT", "x"},           {"BSCALE", long_text()}, {"BZERO", "1E999"},
      {"BLANK", long_text()},    {"EXTEND", long_text()}, {"ZIMAGE", "7"},
      {"TFIELDS", "2000000000"}, {"SIMPLE", "7"},         {"XTENSION", "7"},
      {"THEAP", "-1"},           {"TFORM1", "7"},         {"TBCOL1", "0"},
      {"TSCAL1", long_text()},   {"TZERO1", long_text()}, {"ZSIMPLE", "7"},
      {"ZEXTEND", "7"},          {"ZBITPIX", "7"},        {"ZNAXIS", "7"},
      {"ZNAXIS1", "-1"},         {"ZTILE1", "0"},         {"ZPCOUNT", "-1"},
      {"ZGCOUNT", "-1"},         {"ZCMPTYPE", "7"},       {"ZNAME1", "7"},
      {"ZVAL1", long_text()},    {"ZSCALE", long_text()}, {"ZZERO", long_text()},
      {"ZBLANK", "1.5"},         {"ZDITHER0", "-1"},      {"ZDITHER0", "10001"}};
  for (const auto& [key, value] : wrong)
    EXPECT_NE(fault_of(with(kImage, key, value)).find(key), std::string::npos) << key << value;
}

// cfitsio takes all of these for the key BSCALE.
TEST(HeaderCheck, MisspeltCardsOfSuchANameAreRefused) {
  for (const char* name :
       {"BSCALE= = ", "BSCALE X= ", "HIERARCH BSCALE = ", "HIERARCH  BSCALE= "}) {
    Cards cards = kImage;
    cards.push_back(name + long_text());
    EXPECT_NE(fault_of(cards).find("BSCALE"), std::string::npos) << name;
  }
  Cards cards = kImage;
  cards.push_back("HIERARCH ESO DET BSCALE = " + long_text());
  EXPECT_EQ(fault_of(cards), "");
}

TEST(HeaderCheck, TheSecondCardOfOneNameIsCheckedToo) {
  Cards cards = kImage;
  cards.push_back(raw_card("NAXIS", "130"));
  EXPECT_NE(fault_of(cards), "");
}

TEST(HeaderCheck, MandatoryKeysAreInTheirPlaces) {
  for (std::size_t i = 1; i < kImage.size(); ++i) {
    Cards cards = kImage;
    cards.erase(cards.begin() + static_cast<std::ptrdiff_t>(i));
    EXPECT_NE(fault_of(cards).find("place"), std::string::npos) << i;
  }
  Cards cards = kImage;
  std::swap(cards[3], cards[4]);
  EXPECT_NE(fault_of(cards).find("NAXIS1 is not in its place"), std::string::npos);
  EXPECT_NE(fault_of(with(kCompressed, "BITPIX", "16")).find("a table must"), std::string::npos);
  cards = with(kCompressed, "NAXIS", "1");
  cards.erase(cards.begin() + 4);
  EXPECT_NE(fault_of(cards).find("a table must"), std::string::npos);
}

TEST(HeaderCheck, SizesAreThoseOfAFile) {
  EXPECT_NE(fault_of(with(kImage, "NAXIS1", "4611686018427387904")), "");
  EXPECT_NE(fault_of(with(kImage, "PCOUNT", "9223372036854775807")), "");
  const Cards bytes = with(with(kImage, "BITPIX", "8"), "NAXIS2", "1");
  EXPECT_EQ(fault_of(with(bytes, "NAXIS1", "4611686018427387904")), "");
  EXPECT_NE(fault_of(with(bytes, "NAXIS1", "4611686018427387905")), "");
  EXPECT_NE(fault_of(with(kImage, "GCOUNT", "9223372036854775807")), "");
}

TEST(HeaderCheck, ColumnsHaveFormatsThatAddUp) {
  for (const char* format : {"'1PB(27)'", "'8A4'", "'1D'", "'K'", "'64X'", "'2E'"})
    EXPECT_EQ(fault_of(with(kCompressed, "TFORM1", format)), "") << format;
  for (const char* format : {"'8A0'", "'8A9'", "'3PB'", "'1P'", "'1Z'", "''",
                             "'99999999999999999999D'", "'2305843009213693953D'", "'-1D'"})
    EXPECT_NE(fault_of(with(kCompressed, "TFORM1", format)).find("the format of a column"),
              std::string::npos)
        << format;
  EXPECT_NE(fault_of(with(kCompressed, "TFORM1", "7")), "");
  EXPECT_NE(fault_of(with(kCompressed, "TFORM1", "'2D'")).find("NAXIS1 is 8"), std::string::npos);
  Cards twice = with(kCompressed, "TFORM1", "'1J'");
  twice.push_back(raw_card("TFORM1", "'1J'"));
  EXPECT_NE(fault_of(twice).find("twice"), std::string::npos);
  // Those of columns that the table does not have mean nothing.
  for (const char* key : {"TFORM2", "TFORM999"})
    EXPECT_EQ(fault_of(with(kCompressed, key, "'1D'")), "");
  EXPECT_NE(fault_of(with(kCompressed, "TFIELDS", "2")), "");
  EXPECT_NE(fault_of(with(kCompressed, "TNULL1", long_text())), "");
  EXPECT_NE(fault_of(with(kCompressed, "TSCAL1", long_text())), "");
}

TEST(HeaderCheck, ColumnsOfTextTablesHaveAWidth) {
  const Cards table{raw_card("XTENSION", "'TABLE   '"),
                    raw_card("BITPIX", "8"),
                    raw_card("NAXIS", "2"),
                    raw_card("NAXIS1", "8"),
                    raw_card("NAXIS2", "48"),
                    raw_card("PCOUNT", "0"),
                    raw_card("GCOUNT", "1"),
                    raw_card("TFIELDS", "1"),
                    raw_card("TBCOL1", "1"),
                    raw_card("TFORM1", "'I8'")};
  EXPECT_EQ(fault_of(table), "");
  for (const char* format : {"'I0'", "'A20000'", "'X8'", "'I'", "''"})
    EXPECT_NE(fault_of(with(table, "TFORM1", format)).find("the format of a column"),
              std::string::npos)
        << format;
}

TEST(HeaderCheck, CompressedImagesHaveTilesByWhichOneCanDivide) {
  const std::vector<std::pair<std::string, std::string>> wrong{
      {"ZTILE1", "0"},        {"ZTILE2", "-3"},          {"ZNAXIS1", "-1"},
      {"ZNAXIS", "0"},        {"ZNAXIS", "7"},           {"ZNAXIS", "4"},
      {"ZVAL1", "0"},         {"ZVAL1", "-32"},          {"ZVAL2", "3"},
      {"ZVAL2", "'x'"},       {"ZBITPIX", "12"},         {"ZCMPTYPE", "'LZMA'"},
      {"ZNAXIS1", "1000000"}, {"ZTILE1", "'a'"},         {"ZDITHER0", "-1"},
      {"ZNAXIS3", "9"},       {"ZNAXIS2", "99999999999"}};
  for (const auto& [key, value] : wrong)
    EXPECT_NE(fault_of(with(kCompressed, key, value)), "") << key << " " << value;
  EXPECT_NE(fault_of(with(kCompressed, "ZVAL1", "2000")).find("BLOCKSIZE"), std::string::npos);
  EXPECT_NE(fault_of(with(kCompressed, "ZNAME100", "'BYTEPIX'")).find("ZNAME"), std::string::npos);
  EXPECT_EQ(fault_of(with(kCompressed, "ZVAL100", "7")), "");
}

// Sizes and tiles whose products do not fit 64 bits, or are 0.
TEST(HeaderCheck, CompressedImagesHaveTilesThatCanBeCounted) {
  const auto without = [](Cards cards, const std::string& key) {
    std::erase_if(cards, [&](const std::string& card) { return card_name(card) == key; });
    return cards;
  };
  EXPECT_NE(fault_of(without(kCompressed, "ZBITPIX")).find("ZBITPIX is missing"),
            std::string::npos);
  EXPECT_NE(fault_of(with(without(kCompressed, "ZTILE1"), "ZNAXIS1", "0")).find("make no sense"),
            std::string::npos);
  for (const char* tile : {"4194304", "1"}) {  // 2^22, of which three make 2^66
    Cards cards = kCompressed;
    for (const char* key : {"ZNAXIS1", "ZNAXIS2", "ZNAXIS3"}) cards = with(cards, key, "4194304");
    for (const char* key : {"ZTILE1", "ZTILE2", "ZTILE3"}) cards = with(cards, key, tile);
    EXPECT_NE(fault_of(cards).find("make no sense"), std::string::npos) << tile;
  }
  for (const char* key : {"ZNAXIS7", "ZTILE7", "ZTILE99"}) {  // of axes that it cannot have
    Cards cards = kCompressed;
    cards.insert(cards.begin() + 9, raw_card(key, "5"));
    EXPECT_EQ(fault_of(cards), "") << key;
  }
}

TEST(HeaderCheck, ATileIsNotLargerThanWhatCanBeUnpacked) {
  Cards cards = kCompressed;
  for (const char* key : {"ZNAXIS2", "ZNAXIS3"}) cards = with(cards, key, "1");
  for (const char* key : {"ZNAXIS1", "ZTILE1"}) cards = with(cards, key, "100000000");
  EXPECT_EQ(fault_of(cards), "");
  for (const char* key : {"ZNAXIS1", "ZTILE1"}) cards = with(cards, key, "2000000000");
  EXPECT_NE(fault_of(cards).find("tiles"), std::string::npos);
}

TEST(HeaderCheck, TextOfAFileReachesNoTerminal) {
  const std::string fault = fault_of(with(kImage, "NAXIS1", "\x1b[31m\a"));
  EXPECT_EQ(fault.find_first_of("\x1b\a"), std::string::npos) << fault;
}

// These were a crash of the program: cfitsio copies such a value into a message that is too short.
TEST(HeaderCheck, TextWhereANumberIsReadIsOneSentence) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "text.fits";
  for (const char* key : {"OFFSETX", "BSCALE", "BLANK"}) {
    Cards cards = kImage;
    cards.push_back(raw_card(key, long_text()));
    write_bytes(path, raw_header(cards) + std::string(2880, '\0'));
    const std::string text = failure_text([&] { FitsFile::open(path).key_int(key); });
    EXPECT_NE(text.find(path), std::string::npos) << text;
    EXPECT_NE(text.find(key), std::string::npos) << text;
  }
}

TEST(HeaderCheck, EveryHduIsCheckedWhenTheFileIsOpened) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "second.fits";
  std::vector<std::string> axes(130, "1");
  std::string extension = raw_image_header(16, axes);
  extension.replace(0, 80, header_of({raw_card("XTENSION", "'IMAGE   '")}).cards);
  write_bytes(path,
              raw_header(kImage) + std::string(2880, '\0') + extension + std::string(2880, '\0'));
  const std::string text = failure_text([&] { FitsFile::open(path); });
  EXPECT_NE(text.find("HDU 1 is damaged: NAXIS is 130"), std::string::npos) << text;
}

TEST(HeaderCheck, AHeaderHasAnEnd) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "long.fits";
  std::string cards = raw_header(kImage);
  cards.resize(kImage.size() * 80);
  cards.resize(120'000 * 80, ' ');
  write_bytes(path, cards);
  const std::string text = failure_text([&] { FitsFile::open(path); });
  EXPECT_NE(text.find("does not end"), std::string::npos) << text;
}

}  // namespace
}  // namespace curlew
