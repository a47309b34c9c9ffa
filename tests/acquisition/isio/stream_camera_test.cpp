// A stream in shared memory as a camera: every frame is whole and counted, whatever the writer
// does.
#include "acquisition/isio/stream_camera.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <thread>

#include "acquisition/isio/mapped_stream.h"
#include "service/publish/stream_writer.h"
#include "tests/support/failure_text.h"
#include "tests/support/numbered_frames.h"
#include "tests/support/scratch_directory.h"

namespace curlew {
namespace {

using std::chrono::milliseconds;

constexpr std::uint32_t kCols = 8;
constexpr std::uint32_t kRows = 6;
constexpr std::size_t kPixels = kCols * kRows;

class StreamCameras : public ::testing::Test {
 protected:
  std::unique_ptr<StreamWriter> writer(StreamType type,
                                       std::vector<std::uint32_t> size = {kCols, kRows}) {
    return std::make_unique<StreamWriter>(scratch_.path(),
                                          StreamDescription{"camera", type, size, "adu", "", ""});
  }
  std::string file() const { return scratch_ / "camera.im.shm"; }
  std::unique_ptr<Camera> camera() const { return open_stream_camera(file(), {}); }

  ScratchDirectory scratch_;
};

template <typename T>
void write_numbered(StreamWriter& writer, std::int64_t number) {
  auto* pixels = reinterpret_cast<T*>(writer.begin());
  for (std::size_t k = 0; k < kPixels; ++k) {
    const std::uint16_t value = numbered_pixel(number, k);
    pixels[k] = sizeof(T) == 1 ? static_cast<T>(value >> 8U) : static_cast<T>(value);
  }
  writer.end({number, number, 1'800'000'000'000'000'000 + number * 1'000'000, 0}, 0);
}

template <typename T>
void expect_every_frame(StreamWriter& writer, Camera& camera, PixelType type,
                        std::int64_t updates_before = 0) {
  ASSERT_EQ(camera.format().rows, static_cast<int>(kRows));
  ASSERT_EQ(camera.format().cols, static_cast<int>(kCols));
  ASSERT_EQ(camera.format().pixel_type, type);
  FrameExchange exchange(camera.format(), 4);
  const Streaming streaming(camera, exchange);
  for (std::int64_t number = 1; number <= 20; ++number) {
    write_numbered<T>(writer, number);
    FrameBuffer* frame = exchange.take(5'000'000);
    ASSERT_NE(frame, nullptr);
    EXPECT_TRUE(is_numbered(*frame, number)) << number;
    EXPECT_EQ(frame->header.sequence, number + updates_before);
    EXPECT_EQ(frame->header.renumbered, number == 1);
    // It is TAI, so whole seconds from UTC.
    EXPECT_EQ(frame->header.camera_ns % 1'000'000'000, number * 1'000'000);
    EXPECT_EQ(frame->rows_ready, static_cast<int>(kRows));
    exchange.give_back(frame);
  }
  EXPECT_EQ(camera.counts().delivered, 20);
  EXPECT_EQ(camera.counts().lost, 0);
}

TEST_F(StreamCameras, Unsigned16BitsComeAsTheyAre) {
  const auto stream = writer(StreamType::kU16);
  const auto source = camera();
  expect_every_frame<std::uint16_t>(*stream, *source, PixelType::kU16);
}

TEST_F(StreamCameras, Unsigned8BitsComeAsTheyAre) {
  const auto stream = writer(StreamType::kU8);
  const auto source = camera();
  expect_every_frame<std::uint8_t>(*stream, *source, PixelType::kU8);
}

TEST_F(StreamCameras, WholeNumbersInFloatsComeAsTheyAre) {
  const auto stream = writer(StreamType::kF32);
  write_numbered<float>(*stream, 0);
  const auto source = camera();
  EXPECT_EQ(source->format().scale_adu, 1.0);
  EXPECT_EQ(source->format().zero_adu, 0.0);
  EXPECT_EQ(source->notes().size(), 1U);
  expect_every_frame<float>(*stream, *source, PixelType::kU16, 1);
}

TEST_F(StreamCameras, OtherFloatsKeepTheirValuesToASmallStep) {
  const auto stream = writer(StreamType::kF32);
  const auto fill = [&](float offset) {
    auto* pixels = reinterpret_cast<float*>(stream->begin());
    for (std::size_t k = 0; k < kPixels; ++k)
      pixels[k] = offset + 1e-3F * static_cast<float>(k) - 0.01F;
    pixels[5] = std::nanf("");
    stream->end({}, 0);
  };
  fill(0.0F);
  const auto source = camera();
  const FrameFormat format = source->format();
  ASSERT_LT(format.scale_adu, 1e-5) << "the image spans .047";
  FrameExchange exchange(format, 4);
  const Streaming streaming(*source, exchange);
  fill(0.02F);
  FrameBuffer* frame = exchange.take(5'000'000);
  ASSERT_NE(frame, nullptr);
  const auto* counts = frame->view().data<std::uint16_t>();
  for (std::size_t k = 0; k < kPixels; ++k) {
    if (k == 5)
      EXPECT_EQ(counts[k], 0) << "what is not a number";
    else
      EXPECT_NEAR(format.zero_adu + format.scale_adu * counts[k],
                  0.02 + 1e-3 * static_cast<double>(k) - 0.01, format.scale_adu);
  }
}

// Half the updates come in bursts that nobody can follow. Every one is delivered or lost.
TEST_F(StreamCameras, UpdatesThatNobodySawAreCountedAsLost) {
  const auto stream = writer(StreamType::kU16);
  const auto source = camera();
  FrameExchange exchange(source->format(), 4);
  std::int64_t last = 0;
  {
    const Streaming streaming(*source, exchange);
    for (std::int64_t number = 1; number <= 3000; ++number) {
      write_numbered<std::uint16_t>(*stream, number);
      if (number % 50 == 0) std::this_thread::sleep_for(milliseconds(1));
      if (FrameBuffer* frame = exchange.take(0)) {
        ASSERT_GT(frame->header.sequence, last);
        last = frame->header.sequence;
        ASSERT_TRUE(is_numbered(*frame, last)) << "pixels of two updates";
        exchange.give_back(frame);
      }
    }
    std::this_thread::sleep_for(milliseconds(100));
    if (FrameBuffer* frame = exchange.take(0)) last = frame->header.sequence;
  }
  const FrameCounts counts = source->counts();
  EXPECT_EQ(last, 3000);
  EXPECT_GT(counts.delivered, 50);
  // The first that arrived begins the account.
  EXPECT_LE(counts.delivered + counts.lost, 3000);
  EXPECT_GT(counts.delivered + counts.lost, 2000);
}

TEST_F(StreamCameras, AStreamThatIsMadeAnewEndsTheCamera) {
  auto stream = writer(StreamType::kU16);
  const auto source = camera();
  FrameExchange exchange(source->format(), 4);
  const Streaming streaming(*source, exchange);
  stream.reset();
  stream = writer(StreamType::kU16, {kCols, kRows + 1});
  for (int i = 0; i < 500 && !exchange.closed(); ++i) std::this_thread::sleep_for(milliseconds(10));
  EXPECT_TRUE(exchange.closed());
  EXPECT_NE(source->failure().find("was made anew or removed"), std::string::npos);
}

TEST_F(StreamCameras, ItsSemaphoreIsGivenBack) {
  const auto stream = writer(StreamType::kU16);
  const MappedStream seen = MappedStream::open(file());
  const auto source = camera();
  FrameExchange exchange(source->format(), 4);
  for (int i = 0; i < 25; ++i) {
    const Streaming streaming(*source, exchange);
    EXPECT_EQ(seen.read_pids()[0], getpid());
  }
  EXPECT_EQ(seen.read_pids()[0], -1);
  for (std::int32_t& pid : seen.read_pids()) pid = getppid();
  EXPECT_NE(failure_text([&] { source->start(exchange); }).find("no free semaphore"),
            std::string::npos);
}

TEST_F(StreamCameras, RefusesWhatItCannotRead) {
  const auto refusal = [&] { return failure_text([&] { camera(); }); };
  EXPECT_NE(refusal().find("does not exist; start its writer"), std::string::npos);
  write_bytes(file(), "");
  EXPECT_NE(refusal().find("is empty"), std::string::npos);
  write_bytes(file(), std::string(200, '\0'));
  EXPECT_NE(refusal().find("too short"), std::string::npos);
  write_bytes(file(), std::string(2000, '\0'));
  EXPECT_NE(refusal().find("not complete yet"), std::string::npos);
  std::filesystem::remove(file());
  { const auto stream = writer(StreamType::kU16); }
  const std::string good = read_bytes(file());
  const auto damaged = [&](std::size_t at, const std::string& bytes) {
    std::string copy = good;
    copy.replace(at, bytes.size(), bytes);
    write_bytes(file(), copy);
    return refusal();
  };
  EXPECT_NE(damaged(0, "1.00").find("only 2.00 is read"), std::string::npos);
  EXPECT_NE(damaged(136, std::string(1, '\x0b')).find("elements of type 11"), std::string::npos);
  EXPECT_NE(damaged(240, std::string(1, '\0')).find("graphics card"), std::string::npos);
  EXPECT_NE(damaged(116, "\xff\xff\xff\xff").find("shorter than its axes"), std::string::npos);
  EXPECT_NE(damaged(128, "\x07").find("contradict"), std::string::npos);
  EXPECT_NE(damaged(144, std::string("\x01\x00\x02", 3)).find("circular"), std::string::npos);
  write_bytes(file(), good + std::string(4496 - 384, '\0'));
  EXPECT_NE(refusal().find("DAO_COMPAT"), std::string::npos);
  write_bytes(file(), good + "x");
  EXPECT_NE(refusal().find("its header needs"), std::string::npos);
  std::filesystem::remove(file());
  { const auto cube = writer(StreamType::kU16, {kCols, kRows, 3}); }
  EXPECT_NE(refusal().find("no frames of two axes"), std::string::npos);
  std::filesystem::remove(file());
  { const auto doubles = writer(StreamType::kF64); }
  EXPECT_NE(refusal().find("is of doubles"), std::string::npos);
}

}  // namespace
}  // namespace curlew
