#include "acquisition/fits/fits_file.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/constants.h"
#include "tests/support/failure_text.h"
#include "tests/support/raw_fits.h"
#include "tests/support/scratch_directory.h"
#include "tests/support/text.h"

namespace curlew {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// Expects one sentence that names the file, contains `part` and has no line break.
void expect_sentence(const std::string& text, const std::string& path, const std::string& part) {
  EXPECT_TRUE(contains(text, path)) << text;
  EXPECT_TRUE(contains(text, part)) << text << "\nlacks: " << part;
  EXPECT_FALSE(contains(text, "\n")) << text;
}

template <typename T>
void expect_round_trip(ElementType element, const std::vector<T>& pixels) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "image.fits";
  FitsFile out = FitsFile::create(path);
  out.create_image(element, {static_cast<std::int64_t>(pixels.size())}, "DATA");
  out.write_pixels(0, std::span<const T>(pixels));
  out.commit();
  FitsFile in = FitsFile::open(path);
  in.select("DATA");
  EXPECT_EQ(in.image().element, element);
  std::vector<T> back(pixels.size());
  in.read_pixels(0, std::span<T>(back));
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    if (pixels[i] != pixels[i]) {
      EXPECT_NE(back[i], back[i]) << i;
    } else {
      EXPECT_EQ(back[i], pixels[i]) << i;
    }
  }
}

TEST(FitsFile, EveryTypeComesBackBitForBit) {
  expect_round_trip<std::uint8_t>(ElementType::kU8, {0, 1, 255});
  expect_round_trip<std::int16_t>(ElementType::kI16, {-32768, -1, 0, 32767});
  expect_round_trip<std::uint16_t>(ElementType::kU16, {0, 32767, 32768, 65535});
  expect_round_trip<std::int32_t>(ElementType::kI32, {INT32_MIN, -1, INT32_MAX});
  expect_round_trip<std::uint32_t>(ElementType::kU32, {0, UINT32_MAX});
  expect_round_trip<float>(ElementType::kF32, {0.1F, std::numeric_limits<float>::quiet_NaN(),
                                               -std::numeric_limits<float>::infinity(), 1e-40F});
  expect_round_trip<double>(ElementType::kF64, {0.1, kNaN, kInfinity, 5e-324});
}

TEST(FitsFile, NothingAppearsWithoutCommit) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "out.fits";
  write_bytes(path, "what was there before");
  {
    FitsFile file = FitsFile::create(path);
    file.create_image(ElementType::kU8, {100, 100});
    EXPECT_EQ(scratch.names().size(), 2U);
  }
  EXPECT_EQ(scratch.names(), std::vector<std::string>{"out.fits"});
  EXPECT_EQ(read_bytes(path), "what was there before");

  FitsFile file = FitsFile::create(path);
  file.create_image(ElementType::kU8, {100, 100});
  file.commit();
  EXPECT_EQ(scratch.names(), std::vector<std::string>{"out.fits"});
  EXPECT_EQ(FitsFile::open(path).image().shape, (std::vector<std::int64_t>{100, 100}));
}

TEST(FitsFile, BracketsAndExclamationMarksAreJustNames) {
  const ScratchDirectory scratch;
  for (const std::string name :
       {"a[1:2].fits", "!b.fits", "c(d).fits", " blank.fits", "e.fits.gz", "mem:.fits", "g+1"}) {
    FitsFile out = FitsFile::create(scratch / name);
    out.create_image(ElementType::kU8, {2, 3});
    out.commit();
    EXPECT_EQ(FitsFile::open(scratch / name).image().elements(), 6) << name;
  }
  EXPECT_EQ(scratch.names().size(), 7U);
}

TEST(FitsFile, KeysComeBackWithTheirTypes) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "keys.fits";
  const std::string long_text(300, 'x');
  FitsFile out = FitsFile::create(path);
  out.create_image(ElementType::kU8, {});
  out.write_key("REAL", 633e-9, "a wavelength", "m");
  out.write_key("THIRD", 1.0 / 3.0);
  out.write_key("WHOLE", 150.0);
  out.write_key("INTEGER", std::int64_t{1} << 60);
  out.write_key("FLAG", true);
  out.write_key("TEXT", std::string("it's"));
  out.write_key("LONG", long_text);
  out.write_key("UNKNOWN", kNaN, "nobody knows");
  out.write_key("GREEK", std::string("5 µm"));
  out.write_key("FLAG", false);  // This replaces the first value.
  out.commit();
  FitsFile in = FitsFile::open(path);
  EXPECT_EQ(in.key_double("REAL"), 633e-9);
  EXPECT_EQ(in.key_double("THIRD"), 1.0 / 3.0);
  EXPECT_EQ(in.key_double("WHOLE"), 150.0);
  EXPECT_EQ(in.key_int("INTEGER"), std::int64_t{1} << 60);
  EXPECT_EQ(in.key_string("TEXT"), "it's");
  EXPECT_EQ(in.key_string("LONG"), long_text);
  EXPECT_EQ(in.key_double("UNKNOWN"), std::nullopt);
  EXPECT_EQ(in.key_double("ABSENT"), std::nullopt);
  EXPECT_EQ(in.key_string("ABSENT"), std::nullopt);
  EXPECT_EQ(in.key_string("GREEK"), "5 ??m");  // A header holds ASCII only.
  expect_sentence(failure_text([&] { in.key_double("TEXT"); }), path, "the key TEXT as a number");
  EXPECT_TRUE(contains(read_bytes(path), "[m] a wavelength"));
}

TEST(FitsFile, HdusAreFoundByNameAndIndex) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "hdus.fits";
  FitsFile out = FitsFile::create(path);
  out.create_image(ElementType::kF32, {4, 3, 2}, "SLOPES", "rad");
  out.create_table("FRAMES", std::array<ColumnSpec, 1>{{{"A", 'K', "ns"}}});
  out.select("SLOPES");
  out.write_key("EXTRA", 1.5);
  out.commit();
  FitsFile in = FitsFile::open(path);
  EXPECT_EQ(in.hdu_count(), 3);
  EXPECT_EQ(in.hdu_count(), 3);
  EXPECT_TRUE(in.try_select("SLOPES"));
  EXPECT_TRUE(in.try_select("FRAMES"));
  in.select("slopes");
  EXPECT_TRUE(in.is_image());
  EXPECT_EQ(in.image().shape, (std::vector<std::int64_t>{4, 3, 2}));
  EXPECT_EQ(in.key_string("BUNIT"), "rad");
  EXPECT_EQ(in.key_double("EXTRA"), 1.5);
  in.select(2);
  EXPECT_FALSE(in.is_image());
  EXPECT_FALSE(in.try_select("NOTHERE"));
  EXPECT_FALSE(in.try_select(7));
  expect_sentence(failure_text([&] { in.select("NOTHERE"); }), path, "NOTHERE");
  expect_sentence(failure_text([&] { in.select(7); }), path, "HDU 7");
  in.select("FRAMES");
  expect_sentence(failure_text([&] { in.image(); }), path, "has a table where an image");
}

TEST(FitsFile, FewerPlanesThanPromisedKeepWhatFollows) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "planes.fits";
  constexpr int kPlane = 40 * 50;  // It is more than a FITS block, so shrinking moves blocks.
  std::vector<float> plane(kPlane);
  FitsFile out = FitsFile::create(path);
  out.create_image(ElementType::kF32, {10, 40, 50}, "ONE");
  out.create_image(ElementType::kF32, {10, 40, 50}, "TWO");
  for (int n = 0; n < 4; ++n) {
    for (const std::string name : {"ONE", "TWO"}) {
      plane.assign(kPlane, static_cast<float>(name == "ONE" ? n : -n));
      out.select(name);
      out.write_pixels(n * kPlane, std::span<const float>(plane));
    }
  }
  for (const std::string name : {"ONE", "TWO"}) {
    out.select(name);
    out.resize_planes(4);
  }
  out.commit();
  FitsFile in = FitsFile::open(path);
  for (const std::string name : {"ONE", "TWO"}) {
    in.select(name);
    EXPECT_EQ(in.image().shape, (std::vector<std::int64_t>{4, 40, 50}));
    for (int n = 0; n < 4; ++n) {
      in.read_pixels(n * kPlane, std::span<float>(plane));
      EXPECT_EQ(plane, std::vector<float>(kPlane, static_cast<float>(name == "ONE" ? n : -n)));
    }
  }
}

TEST(FitsFile, PlanesGrow) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "grow.fits";
  const std::vector<std::uint16_t> ones(3000, 1);
  FitsFile out = FitsFile::create(path);
  out.create_image(ElementType::kU16, {0, 30, 100});
  out.write_pixels(0, std::span(ones));
  out.write_pixels(3000, std::span(ones));
  out.resize_planes(2);
  out.create_table("LATER", std::array<ColumnSpec, 1>{{{"A", 'J', ""}}});
  out.select(0);
  out.resize_planes(3);  // Now a table follows.
  out.commit();
  FitsFile in = FitsFile::open(path);
  EXPECT_EQ(in.image().shape, (std::vector<std::int64_t>{3, 30, 100}));
  std::vector<std::uint16_t> back(6000);
  in.read_pixels(0, std::span(back));
  EXPECT_EQ(back, std::vector<std::uint16_t>(6000, 1));
  EXPECT_TRUE(in.try_select("LATER"));
}

TEST(FitsFile, TablesAreWrittenInChunksAndReadByName) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "table.fits";
  const std::array<ColumnSpec, 4> columns{
      {{"N", 'K', "ns"}, {"I", 'J', ""}, {"X", 'D', "rad"}, {"T", 'E', "us"}}};
  FitsFile out = FitsFile::create(path);
  out.create_table("DATA", columns);
  for (std::int64_t chunk = 0; chunk < 3; ++chunk) {
    const std::array<std::int64_t, 2> n{(std::int64_t{1} << 60) + chunk, -chunk};
    const std::array<std::int32_t, 2> i{7, static_cast<std::int32_t>(chunk)};
    const std::array<double, 2> x{0.1, kNaN};
    const std::array<float, 2> t{0.1F, static_cast<float>(kInfinity)};
    out.write_column("N", 2 * chunk, std::span<const std::int64_t>(n));
    out.write_column("I", 2 * chunk, std::span<const std::int32_t>(i));
    out.write_column("X", 2 * chunk, std::span<const double>(x));
    out.write_column("T", 2 * chunk, std::span<const float>(t));
  }
  EXPECT_EQ(out.row_count(), 6);
  out.commit();

  FitsFile in = FitsFile::open(path);
  in.select("DATA");
  ASSERT_EQ(in.row_count(), 6);
  EXPECT_TRUE(in.has_column("X"));
  EXPECT_FALSE(in.has_column("Y"));
  std::vector<std::int64_t> n(6);
  std::vector<double> x(6);
  std::vector<float> t(2);
  in.read_column("N", 0, std::span(n));
  in.read_column("X", 0, std::span(x));
  in.read_column("T", 4, std::span(t));
  EXPECT_EQ(n[4], (std::int64_t{1} << 60) + 2);
  EXPECT_EQ(n[5], -2);
  EXPECT_EQ(x[2], 0.1);
  EXPECT_TRUE(std::isnan(x[3]));
  EXPECT_EQ(t[0], 0.1F);
  EXPECT_TRUE(std::isinf(t[1]));
  expect_sentence(failure_text([&] { in.read_column("Y", 0, std::span(x)); }), path, "column Y");
  expect_sentence(failure_text([&] { in.read_column("X", 5, std::span(x)); }), path, "column X");
}

TEST(FitsFile, BadFilesAreNamedInOneSentence) {
  const ScratchDirectory scratch;
  const auto refusal = [&](const std::string& name) {
    return failure_text([&] { FitsFile::open(scratch / name).image(); });
  };
  write_bytes(scratch / "empty.fits", "");
  write_bytes(scratch / "text.fits", "Dear reader, this is not FITS.\n");
  write_bytes(scratch / "short.fits", "SIMP");
  write_bytes(scratch / "header_cut.fits", raw_image_header(8, {"10", "10"}).substr(0, 160));
  write_bytes(scratch / "negative.fits", raw_image_header(8, {"-10", "10"}));
  write_bytes(scratch / "gzip.fits", "\x1f\x8b and then nonsense");
  write_bytes(scratch / "axes.fits", raw_image_header(8, std::vector<std::string>(12, "1")));
  expect_sentence(refusal("missing.fits"), "missing.fits", "does not exist");
  expect_sentence(refusal("empty.fits"), "empty.fits", "is empty");
  expect_sentence(refusal("text.fits"), "text.fits", "is not a FITS file");
  expect_sentence(refusal("short.fits"), "short.fits", "is not a FITS file");
  expect_sentence(refusal("header_cut.fits"), "header_cut.fits", "header is damaged or cut off");
  expect_sentence(refusal("negative.fits"), "negative.fits", "NAXIS1 is -10");
  expect_sentence(refusal("gzip.fits"), "gzip.fits", "is truncated or damaged");
  expect_sentence(refusal("axes.fits"), "axes.fits", "NAXIS is 12");
  expect_sentence(refusal("."), scratch.path(), "is a directory");
  ASSERT_EQ(mkfifo((scratch / "pipe.fits").c_str(), 0600), 0);
  expect_sentence(refusal("pipe.fits"), "pipe.fits", "is not a regular file");
  if (geteuid() != 0) {  // Root reads everything.
    write_bytes(scratch / "secret.fits", raw_image_header(8, {"1", "1"}));
    std::filesystem::permissions(scratch / "secret.fits", std::filesystem::perms::none);
    expect_sentence(refusal("secret.fits"), "secret.fits", "Permission denied");
  }
}

TEST(FitsFile, TruncatedImagesSayWhatIsThere) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "cut.fits";
  write_bytes(path, raw_image_header(16, {"8", "4", "10"}) + std::string(64 * 7 + 5, '\0'));
  expect_sentence(failure_text([&] { FitsFile::open(path).image(); }), path,
                  "promises 10 frames of 4 x 8 pixels, and 7 whole ones are there (453 of 640");
  write_bytes(path, raw_image_header(16, {"8", "4", "10"}) + std::string(640, '\0'));
  expect_sentence(failure_text([&] { FitsFile::open(path).image(); }), path, "640 of 2880 bytes");
  // Junk after the last block harms nobody.
  write_bytes(path, raw_image_header(16, {"8", "4", "10"}) + std::string(2880 + 5, '\0'));
  EXPECT_EQ(FitsFile::open(path).image().elements(), 320);
}

/// Returns a file with an empty primary and a table of these columns.
std::string raw_table(std::int64_t row_bytes, std::int64_t rows,
                      const std::vector<std::string>& formats) {
  std::vector<std::string> cards{raw_card("XTENSION", "'BINTABLE'"),
                                 raw_card("BITPIX", "8"),
                                 raw_card("NAXIS", "2"),
                                 raw_card("NAXIS1", std::to_string(row_bytes)),
                                 raw_card("NAXIS2", std::to_string(rows)),
                                 raw_card("PCOUNT", "0"),
                                 raw_card("GCOUNT", "1"),
                                 raw_card("TFIELDS", std::to_string(formats.size()))};
  for (std::size_t i = 0; i < formats.size(); ++i) {
    cards.push_back(raw_card("TTYPE" + std::to_string(i + 1), "'C" + std::to_string(i) + "'"));
    cards.push_back(raw_card("TFORM" + std::to_string(i + 1), "'" + formats[i] + "'"));
  }
  const auto bytes = static_cast<std::size_t>(row_bytes * rows);
  return raw_image_header(8, {}) + raw_header(cards) +
         std::string((bytes + 2879) / 2880 * 2880, '\0');
}

TEST(FitsFile, ColumnsThatAreNotWhatIsReadAreRefused) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "table.fits";
  write_bytes(path, raw_table(24 + 8 + 2'000'000 + 8, 2, {"3D", "8A", "2000000A", "1D"}));
  FitsFile in = FitsFile::open(path);
  in.select(1);
  std::vector<double> numbers(2);
  std::vector<std::string> texts(2);
  for (const char* name : {"C0", "C1"})
    expect_sentence(failure_text([&] { in.read_column(name, 0, std::span(numbers)); }), path,
                    "not one number a row");
  for (const char* name : {"C2", "C3"})
    expect_sentence(failure_text([&] { in.read_column(name, 0, std::span(texts)); }), path,
                    "not text, or too long");
  in.read_column("C3", 0, std::span(numbers));
  EXPECT_EQ(numbers[1], 0.0);
}

TEST(FitsFile, ATableMayHaveNoColumnsAndAnImageIsNone) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "table.fits";
  write_bytes(path, raw_table(0, 5, {}));
  FitsFile in = FitsFile::open(path);
  in.select(1);
  EXPECT_LE(in.whole_row_count(), 5);
  in.select(0);
  expect_sentence(failure_text([&] { in.row_count(); }), path, "has an image where a table");
}

TEST(FitsFile, WhatFollowsTheLastHduIsNotTakenForOne) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "more.fits";
  const std::string whole = raw_image_header(8, {"10", "10"}) + std::string(2880, '\0');
  write_bytes(path, whole + std::string(2880, 'x'));
  EXPECT_EQ(FitsFile::open(path).hdu_count(), 1);
  std::string extension = raw_image_header(8, {"10", "10"});
  extension.replace(0, 30, raw_card("XTENSION", "'IMAGE'").substr(0, 30));
  // Its header is cut off before END.
  write_bytes(path, whole + extension.substr(0, 400) + std::string(2480, ' '));
  FitsFile cut = FitsFile::open(path);
  expect_sentence(failure_text([&] { cut.hdu_count(); }), path, "cannot find all its HDUs");
  EXPECT_FALSE(cut.try_select(1));

  extension = raw_image_header(8, {});
  extension.replace(0, 30, raw_card("XTENSION", "'IMAGE'").substr(0, 30));
  std::string many = whole;
  for (int i = 0; i < 10'001; ++i) many += extension;
  write_bytes(path, many);
  expect_sentence(failure_text([&] { FitsFile::open(path); }), path, "more than 10000 HDUs");
}

TEST(FitsFile, AbsurdSizesAreRefusedBeforeAnythingIsAllocated) {
  const ScratchDirectory scratch;
  const auto refusal = [&](const std::string& name, const std::vector<std::string>& axes) {
    write_bytes(scratch / name, raw_image_header(8, axes) + std::string(2880, '\0'));
    return failure_text([&] { FitsFile::open(scratch / name).image(); });
  };
  expect_sentence(refusal("a.fits", {"4294967296", "4294967296", "4294967296"}), "a.fits",
                  "more than any file can hold");
  expect_sentence(refusal("b.fits", {"9223372036854775807", "2"}), "b.fits",
                  "more than any file can hold");
  expect_sentence(refusal("c.fits", {"2000000000", "2000000000"}), "c.fits", "memory");
  EXPECT_NE(refusal("d.fits", {"99999999999999999999", "2"}), "");
  expect_sentence(refusal("e.fits", {"1000", "1000", "1000000"}), "e.fits", "is truncated");

  // This file is as large as its header says, and mostly a hole.
  const std::string path = scratch / "sparse.fits";
  write_bytes(path, raw_image_header(8, {"1000000", "1000000"}));
  std::error_code error;
  std::filesystem::resize_file(path, 2880 + 1000000ULL * 1000000ULL, error);
  if (!error) {
    expect_sentence(failure_text([&] { FitsFile::open(path).image(); }), path, "memory");
  }
}

TEST(FitsFile, TruncatedTablesAreRefusedUnlessAskedForWhatIsThere) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "table.fits";
  const std::vector<std::int64_t> values(2000, 5);
  FitsFile out = FitsFile::create(path);
  out.create_table("DATA", std::array<ColumnSpec, 1>{{{"N", 'K', ""}}});
  out.write_column("N", 0, std::span(values));
  out.commit();
  // The file has two header blocks, then 8 bytes per row. The block that is cut cannot be read.
  std::filesystem::resize_file(path, 2 * 2880 + 4 * 2880 + 1003);
  FitsFile in = FitsFile::open(path);
  in.select("DATA");
  EXPECT_EQ(in.whole_row_count(), 4 * 360);
  expect_sentence(failure_text([&] { in.row_count(); }), path, "2000 rows holds 1440");
}

TEST(FitsFile, CannotBeCreatedWhereThereIsNoPlaceForIt) {
  const ScratchDirectory scratch;
  std::filesystem::create_directory(scratch / "folder");
  expect_sentence(failure_text([&] { FitsFile::create(scratch / "no/such/out.fits"); }), "out.fits",
                  "does not exist");
  expect_sentence(failure_text([&] { FitsFile::create(scratch / "folder"); }), "folder",
                  "is a directory");
  expect_sentence(failure_text([&] { FitsFile::create(scratch / std::string(2000, 'n')); }), "nnn",
                  "longer than cfitsio allows");
  expect_sentence(failure_text([&] { FitsFile::create(scratch / std::string(252, 'n')); }), "nnn",
                  "cannot be written");
}

// Writes an image in a process that may write no file larger than limit_bytes. Exit code 0 means
// that there was one Failure, which names the file, and that nothing is left behind.
[[noreturn]] void write_against_limit(const ScratchDirectory& scratch, rlim_t limit_bytes,
                                      std::int64_t planes) {
  std::signal(SIGXFSZ, SIG_IGN);
  const rlimit limit{limit_bytes, limit_bytes};
  setrlimit(RLIMIT_FSIZE, &limit);
  const std::string path = scratch / "full.fits";
  const std::vector<std::uint16_t> plane(1000, 3);
  const std::string text = failure_text([&] {
    FitsFile file = FitsFile::create(path);
    file.create_image(ElementType::kU16, {planes, 10, 100});
    for (std::int64_t n = 0; n < planes; ++n) file.write_pixels(n * 1000, std::span(plane));
    file.commit();
  });
  if (!contains(text, path) || !contains(text, "disk full?")) std::_Exit(1);
  std::_Exit(scratch.names().empty() ? 0 : 2);
}

TEST(FitsFileDeathTest, DiskFullIsOneSentenceAndLeavesNothing) {
  const ScratchDirectory scratch;
  // The disk is full while pixels are written, or, for small files, only when the file is closed.
  EXPECT_EXIT(write_against_limit(scratch, 200000, 1000), testing::ExitedWithCode(0), "");
  EXPECT_EXIT(write_against_limit(scratch, 5000, 2), testing::ExitedWithCode(0), "");
  EXPECT_EXIT(write_against_limit(scratch, 0, 1), testing::ExitedWithCode(0), "");
}

TEST(FitsFile, ImagesMayBeSelectedBeforeTheirFirstPixelIsWritten) {
  // cfitsio said "column number < 1 or > tfields" here.
  const ScratchDirectory scratch;
  FitsFile out = FitsFile::create(scratch / "two.fits");
  out.create_image(ElementType::kU8, {});
  out.create_image(ElementType::kF32, {2, 3}, "A");
  out.create_image(ElementType::kF32, {2, 3}, "B");
  const std::vector<float> row{1, 2, 3};
  for (const int hdu : {1, 2, 1, 2}) {
    out.select(hdu);
    out.write_pixels<float>(3, row);
  }
  out.commit();
  FitsFile in = FitsFile::open(scratch / "two.fits");
  for (const char* name : {"A", "B"}) {
    in.select(name);
    std::vector<float> all(6);
    in.read_pixels<float>(0, all);
    EXPECT_EQ(all, (std::vector<float>{0, 0, 0, 1, 2, 3}));
  }
}

}  // namespace
}  // namespace curlew
