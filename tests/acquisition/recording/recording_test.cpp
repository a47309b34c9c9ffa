#include "acquisition/recording/recording.h"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <cmath>
#include <csignal>
#include <cstdlib>
#include <limits>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "acquisition/recording/fits_source.h"
#include "tests/support/astropy_peer.h"
#include "tests/support/constants.h"
#include "tests/support/failure_text.h"
#include "tests/support/scratch_directory.h"
#include "tests/support/text.h"

namespace curlew {
namespace {

constexpr unsigned kRecordingSeed = 20261123;

FrameFormat format_of(PixelType type) {
  FrameFormat format;
  format.rows = 37;
  format.cols = 53;
  format.pixel_type = type;
  format.offset_x_px = 16;
  format.offset_y_px = 24;
  format.binning = 2;
  return format;
}

const Optics kOptics{.pitch_m = 1.5e-4,
                     .focal_m = 3.7e-3,
                     .pixel_m = 5.5e-6,
                     .wavelength_m = 633e-9,
                     .magnification = 0.8,
                     .mirrored = true};
const Detector kDetector{
    .e_per_adu = 2.2, .read_noise_e = 1.3, .saturation_adu = 4095.0, .bit_depth = 12};
const std::vector<TruthVortex> kTruth{{0, 1.25, 2.5, 1, 3.5}, {2, 0.1, 7.75, -1, kInfinity}};

// Makes the n-th of a reproducible series of frames.
void fill(FrameBuffer& frame, int n) {
  std::mt19937 random(kRecordingSeed + static_cast<unsigned>(n));
  for (std::size_t i = 0; i < frame.format().bytes(); ++i) {
    frame.data()[i] = static_cast<std::byte>(random() & 0xFFU);
  }
  frame.header.sequence = 1000 + 3 * n;
  frame.header.camera_ns = (std::int64_t{1} << 60) + n;
  frame.header.received_ns = 1'800'000'000'000'000'000 + n;
  frame.header.status = n == 1 ? kFrameLate | kFrameGapBefore : kFrameOk;
}

void write_recording(const std::string& path, PixelType type, int frames) {
  FrameBuffer frame(format_of(type));
  RecordingWriter writer(path, frame.format(), kOptics, kDetector, "curlew 0.0 test");
  for (int n = 0; n < frames; ++n) {
    fill(frame, n);
    writer.append(frame.view(), frame.header);
  }
  writer.write_truth(kTruth);
  writer.commit();
}

TEST(Recording, ReplaysAsItWasRecorded) {
  SCOPED_TRACE(kRecordingSeed);
  for (const PixelType type : {PixelType::kU8, PixelType::kU16}) {
    const ScratchDirectory scratch;
    const std::string path = scratch / "rec.fits";
    write_recording(path, type, 11);
    EXPECT_EQ(scratch.names(), std::vector<std::string>{"rec.fits"});

    FitsSource source({path});
    EXPECT_EQ(source.frame_count(), 11);
    EXPECT_EQ(source.map_report(), "");
    EXPECT_EQ(source.format().pixel_type, type);
    EXPECT_EQ(source.format().offset_x_px, 16);
    EXPECT_EQ(source.format().offset_y_px, 24);
    EXPECT_EQ(source.format().binning, 2);
    EXPECT_EQ(source.optics().pitch_m, kOptics.pitch_m);
    EXPECT_EQ(source.optics().focal_m, kOptics.focal_m);
    EXPECT_EQ(source.optics().pixel_m, kOptics.pixel_m);
    EXPECT_EQ(source.optics().wavelength_m, kOptics.wavelength_m);
    EXPECT_EQ(source.optics().magnification, kOptics.magnification);
    EXPECT_TRUE(source.optics().mirrored);
    EXPECT_EQ(source.detector().e_per_adu, kDetector.e_per_adu);
    EXPECT_EQ(source.detector().read_noise_e, kDetector.read_noise_e);
    EXPECT_EQ(source.detector().saturation_adu, kDetector.saturation_adu);
    EXPECT_EQ(source.detector().bit_depth, kDetector.bit_depth);

    FrameBuffer expected(source.format());
    FrameBuffer got(source.format());
    for (int n = 0; n < 11; ++n) {
      fill(expected, n);
      ASSERT_EQ(source.next(got), Delivery::kFrame);
      EXPECT_TRUE(std::equal(got.data(), got.data() + got.format().bytes(), expected.data())) << n;
      EXPECT_EQ(got.header.sequence, expected.header.sequence);
      EXPECT_EQ(got.header.camera_ns, expected.header.camera_ns);
      EXPECT_EQ(got.header.received_ns, expected.header.received_ns);
      EXPECT_EQ(got.header.status, expected.header.status);
    }
    EXPECT_EQ(source.next(got), Delivery::kEnd);
  }
}

TEST(Recording, TwoRecordingsOfTheSameAreTheSameBytes) {
  const ScratchDirectory scratch;
  write_recording(scratch / "a.fits", PixelType::kU16, 3);
  write_recording(scratch / "b.fits", PixelType::kU16, 3);
  EXPECT_EQ(read_bytes(scratch / "a.fits"), read_bytes(scratch / "b.fits"));
}

TEST(Recording, TheTruthComesBack) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "rec.fits";
  write_recording(path, PixelType::kU8, 3);
  const std::vector<TruthVortex> truth = read_truth(path).value();
  ASSERT_EQ(truth.size(), kTruth.size());
  for (std::size_t i = 0; i < truth.size(); ++i) {
    EXPECT_EQ(truth[i].frame, kTruth[i].frame);
    EXPECT_EQ(truth[i].x, kTruth[i].x);
    EXPECT_EQ(truth[i].y, kTruth[i].y);
    EXPECT_EQ(truth[i].charge, kTruth[i].charge);
    EXPECT_EQ(truth[i].separation, kTruth[i].separation);
  }
}

TEST(Recording, WithoutVorticesTheTruthIsAnEmptyTableAndWithoutTruthThereIsNone) {
  const ScratchDirectory scratch;
  FrameBuffer frame(format_of(PixelType::kU8));
  for (const bool with_truth : {true, false}) {
    RecordingWriter writer(scratch / "rec.fits", frame.format(), Optics{}, Detector{}, "test");
    writer.append(frame.view(), frame.header);
    if (with_truth) writer.write_truth({});
    writer.commit();
    const auto truth = read_truth(scratch / "rec.fits");
    EXPECT_EQ(truth.has_value(), with_truth);
    EXPECT_TRUE(!truth || truth->empty());
  }
  // What is not known must not be in the header.
  const FitsSource source({scratch / "rec.fits"});
  EXPECT_TRUE(std::isnan(source.optics().pitch_m));
  EXPECT_EQ(source.optics().magnification, 1.0);
  EXPECT_FALSE(source.optics().mirrored);
  EXPECT_EQ(source.detector().bit_depth, 0);
}

TEST(Recording, NothingIsLeftOfARecordingThatIsNotCompleted) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "rec.fits";
  FrameBuffer frame(format_of(PixelType::kU16));
  {
    RecordingWriter writer(path, frame.format(), Optics{}, Detector{}, "test");
    writer.append(frame.view(), frame.header);
  }
  EXPECT_TRUE(scratch.names().empty());
  const std::string no_frame = failure_text(
      [&] { RecordingWriter(path, frame.format(), Optics{}, Detector{}, "test").commit(); });
  EXPECT_TRUE(contains(no_frame, path) && contains(no_frame, "no frame")) << no_frame;
  const std::string wrong_size = failure_text([&] {
    RecordingWriter writer(path, frame.format(), Optics{}, Detector{}, "test");
    writer.append(FrameBuffer(format_of(PixelType::kU8)).view(), frame.header);
  });
  EXPECT_TRUE(contains(wrong_size, "37 x 53 pixels of 16 bits")) << wrong_size;
  FrameFormat mapped = frame.format();
  mapped.scale_adu = 0.5;
  const std::string not_adu =
      failure_text([&] { RecordingWriter(path, mapped, Optics{}, Detector{}, "test"); });
  EXPECT_TRUE(contains(not_adu, "not in plain ADU")) << not_adu;
  EXPECT_TRUE(scratch.names().empty());
}

TEST(Recording, NothingIsLeftOfAWrongNumberOfFramesAlthoughTheWriterLives) {
  const ScratchDirectory scratch;
  FrameBuffer frame(format_of(PixelType::kU16));
  for (const int count : {0, 1, 3}) {
    RecordingWriter writer = RecordingWriter::compressed(scratch / "rec.fits", frame.format(),
                                                         Optics{}, Detector{}, "test", 2);
    const std::string text = failure_text([&] {
      for (int i = 0; i < count; ++i) writer.append(frame.view(), frame.header);
      writer.commit();
    });
    EXPECT_TRUE(contains(text, "rec.fits")) << text;
    EXPECT_TRUE(scratch.names().empty()) << count << " frames";
  }
}

TEST(Recording, AstropyReadsIt) {
  const ScratchDirectory scratch;
  for (const PixelType type : {PixelType::kU8, PixelType::kU16}) {
    const std::string path = scratch / "rec.fits";
    write_recording(path, type, 3);
    const PeerAnswer answer = ask_astropy("describe", path);
    if (answer.exit_code == 77) GTEST_SKIP() << "astropy is not installed";
    ASSERT_EQ(answer.exit_code, 0) << answer.text;
    double sum = 0.0;
    FrameBuffer frame(format_of(type));
    for (int n = 0; n < 3; ++n) {
      fill(frame, n);
      for (std::size_t k = 0; k < frame.format().pixels(); ++k) {
        sum += type == PixelType::kU8 ? frame.view().data<std::uint8_t>()[k]
                                      : frame.view().data<std::uint16_t>()[k];
      }
    }
    const bool u8 = type == PixelType::kU8;
    for (const std::string& part : {
             u8 ? std::string("hdu 0 PRIMARY image uint8 [3x37x53] bitpix 8")
                : std::string("hdu 0 PRIMARY image uint16 [3x37x53] bitpix 16"),
             "sum 0 " + std::to_string(sum) + " nan 0",
             std::string("key 0 BUNIT 'adu'"),
             std::string("key 0 CREATOR 'curlew 0.0 test'"),
             std::string("key 0 PITCH_M 0.00015 / [m] lenslet pitch"),
             std::string("key 0 WAVELEN 6.33e-07 / [m] wavelength"),
             std::string("key 0 PARITY -1 / "),
             std::string("hdu 1 FRAMES table 3"),
             std::string("column SEQUENCE K -: 1000 1003 1006"),
             std::string("column CAMERA_NS K ns: 1152921504606846976 1152921504606846977"),
             std::string("column RECEIVED_NS K ns: 1800000000000000000"),
             std::string("column STATUS J -: 0 10 0"),
             std::string("hdu 2 TRUTH table 2"),
             std::string("column FRAME K -: 0 2"),
             std::string("column X D -: 1.25 0.1"),
             std::string("column Y D -: 2.5 7.75"),
             std::string("column CHARGE J -: 1 -1"),
             std::string("column SEPARATION D -: 3.5 inf"),
         }) {
      EXPECT_TRUE(contains(answer.text, part)) << "lacks: " << part << "\n" << answer.text;
    }
    EXPECT_EQ(contains(answer.text, "key 0 BZERO 32768"), !u8);
  }
}

// Records until the file may not grow further. Exit code 0 means that there was one Failure and
// that nothing is left behind.
[[noreturn]] void record_against_limit(const ScratchDirectory& scratch) {
  std::signal(SIGXFSZ, SIG_IGN);
  const rlimit limit{100000, 100000};
  setrlimit(RLIMIT_FSIZE, &limit);
  const std::string text =
      failure_text([&] { write_recording(scratch / "full.fits", PixelType::kU16, 200); });
  if (!contains(text, "full.fits") || !contains(text, "disk full?")) std::_Exit(1);
  std::_Exit(scratch.names().empty() ? 0 : 2);
}

TEST(RecordingDeathTest, DiskFullIsOneSentenceAndLeavesNothing) {
  const ScratchDirectory scratch;
  EXPECT_EXIT(record_against_limit(scratch), testing::ExitedWithCode(0), "");
}

}  // namespace
}  // namespace curlew
