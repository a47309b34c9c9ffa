// This serves images whose every pixel is known as a GigE Vision camera, and checks what arrives.
#pragma once

#include <gtest/gtest.h>

#include <chrono>
#include <cstdint>
#include <cstring>
#include <memory>
#include <random>
#include <vector>

#include "acquisition/aravis/aravis_camera.h"
#include "acquisition/aravis/aravis_pixels.h"
#include "core/frame_exchange.h"
#include "tests/support/fake_gige_camera.h"
#include "tests/support/loopback.h"
#include "tests/support/pixel_packing.h"

namespace curlew {

/// Holds images of random pixels, as counts and as the bytes that a camera sends.
struct KnownImages {
  int rows = 0;
  int cols = 0;
  PixelType type = PixelType::kU16;
  std::vector<std::vector<std::uint16_t>> counts;
  std::vector<std::vector<std::byte>> bytes;

  bool shows(const FrameView& view, std::int64_t sequence) const {
    const auto& expected = counts[FakeGigeCamera::image_of(sequence, counts.size())];
    if (view.rows != rows || view.cols != cols || view.pixel_type != type) return false;
    if (type == PixelType::kU16)
      return std::memcmp(view.pixels, expected.data(), expected.size() * 2) == 0;
    for (std::size_t i = 0; i < expected.size(); ++i)
      if (view.data<std::uint8_t>()[i] != expected[i]) return false;
    return true;
  }
};

/// Makes such images. left_shift: how many bits up in the 16 the camera puts its values.
inline KnownImages known_images(int rows, int cols, std::uint32_t code, std::size_t images = 7,
                                int left_shift = 0) {
  const PixelCoding& coding = *find_pixel_coding(code);
  KnownImages known{rows, cols, coding.type(), {}, {}};
  std::mt19937 random(17);
  for (std::size_t i = 0; i < images; ++i) {
    std::vector<std::uint16_t> counts(static_cast<std::size_t>(rows) *
                                      static_cast<std::size_t>(cols));
    const unsigned largest = (1U << (coding.bits - left_shift)) - 1;
    for (auto& count : counts)
      count = static_cast<std::uint16_t>((random() & largest) << left_shift);
    const auto sent = packed(coding, counts);
    const auto* begin = reinterpret_cast<const std::byte*>(sent.data());
    known.bytes.emplace_back(begin, begin + sent.size());
    known.counts.push_back(std::move(counts));
  }
  return known;
}

constexpr std::uint32_t kMono8 = 0x01080001;
constexpr std::uint32_t kMono12 = 0x01100005;
constexpr std::uint32_t kMono16 = 0x01100007;

/// Is the base of tests that serve a camera. Each test has a network to itself, or waits for its
/// turn.
class ServedCamera : public testing::Test {
 protected:
  void SetUp() override { addresses_ = claim_loopback(); }

  std::unique_ptr<FakeGigeCamera> serve(const KnownImages& images, FakeGigeOptions options = {}) {
    return std::make_unique<FakeGigeCamera>(images.rows, images.cols, images.bytes, options);
  }
  static CameraOptions packets(int bytes = 8192) {
    CameraOptions options;
    options.packet_size_bytes = bytes;
    options.frame_retention_us = 1'000'000;  // The server shares its CPUs with others.
    return options;
  }
  static std::unique_ptr<Camera> open(const CameraOptions& options = packets()) {
    return open_aravis_camera("127.0.0.1", options, {});
  }

  int addresses_ = 0;
};

/// Plays the pipeline: it takes frames and checks them.
class Taker {
 public:
  Taker(FrameExchange& exchange, const KnownImages& images)
      : exchange_(exchange), images_(images) {}

  /// Takes `frames` more frames. Returns false if none comes for ten seconds.
  bool take(int frames) {
    for (int i = 0; i < frames; ++i)
      if (!take_one(10'000'000)) return false;
    return true;
  }
  bool take_one(std::int64_t timeout_us) {
    FrameBuffer* frame = exchange_.take(timeout_us);
    if (frame == nullptr) return false;
    check(*frame);
    exchange_.give_back(frame);
    return true;
  }

  int taken = 0;
  std::int64_t last = -1;

 private:
  void check(const FrameBuffer& frame) {
    const FrameHeader& header = frame.header;
    EXPECT_TRUE(images_.shows(frame.view(), header.sequence)) << "frame " << header.sequence;
    EXPECT_EQ(frame.rows_ready.load(), images_.rows);
    EXPECT_GT(header.camera_ns, 0);
    EXPECT_GT(header.received_ns, 1'600'000'000'000'000'000);
    EXPECT_LE(header.received, std::chrono::steady_clock::now());
    if (taken > 0) {
      EXPECT_GT(header.sequence, last);
    }
    last = header.sequence;
    ++taken;
  }

  FrameExchange& exchange_;
  const KnownImages& images_;
};

inline std::int64_t total(const FrameCounts& counts) { return counts.delivered + counts.dropped(); }

}  // namespace curlew
