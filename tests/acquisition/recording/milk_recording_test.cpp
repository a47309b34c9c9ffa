// Recordings of milk: cubes with times in a text beside them, read and written.
#include "acquisition/recording/milk_recording.h"

#include <gtest/gtest.h>

#include <cstdio>

#include "acquisition/fits/fits_file.h"
#include "acquisition/recording/fits_source.h"
#include "tests/support/failure_text.h"
#include "tests/support/numbered_frames.h"
#include "tests/support/scratch_directory.h"

namespace curlew {
namespace {

constexpr std::int64_t kLogged = 1'800'000'000'123'456'789;

/// Gives numbered frames whose camera has a clock of the given kind.
class NumberedFrames final : public FrameSource {
 public:
  explicit NumberedFrames(std::int64_t camera_lag_ns) : lag_ns_(camera_lag_ns) {}
  const FrameFormat& format() const override { return format_; }
  std::int64_t frame_count() const override { return 5; }
  Delivery next(FrameBuffer& into) override {
    if (given_ == 5) return Delivery::kEnd;
    fill_numbered(into, 40 + 2 * given_);
    into.header.received_ns = kLogged + given_ * 1'000'001;
    into.header.camera_ns = lag_ns_ < 0 ? given_ : into.header.received_ns - lag_ns_;
    ++given_;
    return Delivery::kFrame;
  }

 private:
  FrameFormat format_{.rows = 4, .cols = 6};
  std::int64_t lag_ns_;
  std::int64_t given_ = 0;
};

std::string text_beside(const std::string& cube) {
  return cube.substr(0, cube.size() - 5) + ".txt";
}

TEST(MilkRecordings, ComeBackAsTheyWereWritten) {
  const ScratchDirectory scratch;
  NumberedFrames frames(2'345'678);
  const std::string path = write_milk_recording(scratch.path(), "wfs", frames);
  EXPECT_EQ(path, scratch / "20270115/wfs/wfs_08:00:00.123456789.fits");
  FitsSource back({path});
  EXPECT_EQ(back.frame_count(), 5);
  FrameBuffer frame(back.format());
  for (std::int64_t i = 0; i < 5; ++i) {
    ASSERT_EQ(back.next(frame), Delivery::kFrame);
    EXPECT_TRUE(is_numbered(frame, 40 + 2 * i));
    EXPECT_EQ(frame.header.sequence, 40 + 2 * i);
    const std::int64_t received = kLogged + i * 1'000'001;
    EXPECT_EQ(frame.header.received_ns, received) << "to the nanosecond";
    EXPECT_NEAR(static_cast<double>(frame.header.camera_ns - (received - 2'345'678)), 0.0, 500.0)
        << "milk keeps microseconds";
  }
  FitsFile file = FitsFile::open(path);
  EXPECT_EQ(file.key_string("UT-STR"), "08:00:00.12");
  EXPECT_NEAR(file.key_double("MJD-STR").value(), 61420.0 + 8.0 / 24.0, 1e-5);
}

TEST(MilkRecordings, LinesAreThoseOfMilk) {
  const ScratchDirectory scratch;
  NumberedFrames frames(0);
  const std::string text =
      read_bytes(text_beside(write_milk_recording(scratch.path(), "w", frames)));
  // "%10ld %10lu %15.9lf %20.9lf %17.6lf %10ld %10ld"
  EXPECT_NE(text.find("\n         1          1     0.001000001 1800000000.124456790 "
                      "1800000000.124457         42          0\n"),
            std::string::npos)
      << text;
}

TEST(MilkRecordings, AClockThatIsNotUtcIsLeftOut) {
  const ScratchDirectory scratch;
  NumberedFrames frames(-1);
  FitsSource back({write_milk_recording(scratch.path(), "w", frames)});
  FrameBuffer frame(back.format());
  ASSERT_EQ(back.next(frame), Delivery::kFrame);
  EXPECT_EQ(frame.header.camera_ns, kLogged)
      << "where acquisition is 0 the log's time stands for it";
}

TEST(MilkRecordings, TextsOfOthersAreNotTimes) {
  const ScratchDirectory scratch;
  NumberedFrames frames(0);
  const std::string path = write_milk_recording(scratch.path(), "w", frames);
  const std::string good = read_bytes(text_beside(path));
  write_bytes(text_beside(path), "Notes of the night: all was well.\n");
  EXPECT_FALSE(read_milk_times(path).has_value());
  write_bytes(text_beside(path), "# Notes\nall was well 1 2 3 4 5\n");
  EXPECT_FALSE(read_milk_times(path).has_value());
  write_bytes(text_beside(path), good + "5 5 nonsense\n");
  EXPECT_NE(failure_text([&] { read_milk_times(path); }).find(".txt:8 is none of milk's lines"),
            std::string::npos);
  // A log that ends early is as a table that was cut off.
  write_bytes(text_beside(path), good.substr(0, good.find("\n         3")) + "\n");
  FitsSource back({path});
  FrameBuffer frame(back.format());
  for (int i = 0; i < 5; ++i) ASSERT_EQ(back.next(frame), Delivery::kFrame);
  EXPECT_EQ(frame.header.sequence, 46) << "44, and counted on";
  EXPECT_EQ(frame.header.received_ns, 0);
}

TEST(MilkRecordings, AFolderIsAllItsCubesInOrder) {
  const ScratchDirectory scratch;
  EXPECT_NE(failure_text([&] { fits_files_of(scratch.path()); }).find("holds no FITS file"),
            std::string::npos);
  for (const char* stream : {"b", "a"}) {
    NumberedFrames frames(0);
    write_milk_recording(scratch.path(), stream, frames);
  }
  const std::vector<std::string> files = fits_files_of(scratch.path());
  ASSERT_EQ(files.size(), 2U);
  EXPECT_NE(files[0].find("/a/a_"), std::string::npos);
  EXPECT_EQ(fits_files_of("one.fits"), std::vector<std::string>{"one.fits"});
}

}  // namespace
}  // namespace curlew
