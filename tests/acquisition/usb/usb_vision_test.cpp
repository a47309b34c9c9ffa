// These tests stream from an emulated USB3 Vision camera through Aravis, unplug it in mid-frame and
// plug it in again.
#include <gtest/gtest.h>

#include <chrono>
#include <future>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <thread>

#include "acquisition/aravis/aravis_camera.h"
#include "acquisition/usb/usb_devices.h"
#include "acquisition/usb/usb_watcher.h"
#include "core/error.h"
#include "tests/acquisition/usb/emulated_vision_camera.h"
#include "tests/support/failure_text.h"

namespace curlew {
namespace {

constexpr int kRows = 128;
constexpr int kCols = 256;
constexpr std::int64_t kLong_us = 10'000'000;

std::vector<std::uint16_t> vision_pixels(std::uint64_t id) {
  std::vector<std::uint16_t> pixels(kRows * kCols);
  std::mt19937 random(static_cast<unsigned>(id));
  for (std::uint16_t& pixel : pixels) pixel = static_cast<std::uint16_t>(random());
  return pixels;
}

class UsbVision : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!usb_can_be_emulated()) GTEST_SKIP() << "run it under umockdev-wrapper";
#if defined(__SANITIZE_THREAD__)
    GTEST_SKIP() << "TSan does not see the locks of Aravis and GLib and would report races";
#endif
    device_ = std::make_unique<EmulatedVisionCamera>(kRows, kCols);
  }

  static std::unique_ptr<Camera> open() {
    return open_aravis_camera(
        std::string(EmulatedVisionCamera::kVendor) + "-" + EmulatedVisionCamera::kSerial,
        CameraOptions(), {});
  }

  /// Plugs the camera in and waits for the news, as the daemon does, because Aravis does not know
  /// sooner.
  void plug() {
    std::promise<void> arrived;
    const UsbWatcher watcher([&](UsbChange change) {
      if (change == UsbChange::kArrived) arrived.set_value();
    });
    device_->plug();
    ASSERT_EQ(arrived.get_future().wait_for(std::chrono::seconds(10)), std::future_status::ready);
  }

  /// Sends frames [from, to), takes each one before the next is sent, and compares every pixel.
  void stream(FrameExchange& exchange, std::uint64_t from, std::uint64_t to) {
    for (std::uint64_t id = from; id < to; ++id) {
      const auto pixels = vision_pixels(id);
      ASSERT_TRUE(device_->send_frame(id, pixels));
      FrameBuffer* frame = exchange.take(kLong_us);
      ASSERT_NE(frame, nullptr) << "frame " << id;
      EXPECT_EQ(frame->header.status, kFrameOk);
      EXPECT_EQ(frame->header.renumbered, id == from);
      EXPECT_TRUE(std::equal(pixels.begin(), pixels.end(), frame->view().data<std::uint16_t>()))
          << "frame " << id;
      exchange.give_back(frame);
    }
  }

  std::unique_ptr<EmulatedVisionCamera> device_;
};

TEST_F(UsbVision, IsListedAsAravisCamera) {
  plug();
  const auto cameras = list_usb_cameras();
  ASSERT_EQ(cameras.size(), 1U);
  EXPECT_EQ(cameras[0].source, "aravis:Curlew Works-V0001");
  EXPECT_EQ(cameras[0].problem, "");
  EXPECT_NE(cameras[0].description.find("USB3 Vision"), std::string::npos);
}

TEST_F(UsbVision, StreamsEveryPixelThroughAravis) {
  plug();
  const auto camera = open();
  EXPECT_EQ(camera->format().rows, kRows);
  EXPECT_EQ(camera->format().cols, kCols);
  EXPECT_EQ(camera->format().pixel_type, PixelType::kU16);
  EXPECT_NE(camera->description().find("Curlew Works Vision 1"), std::string::npos)
      << camera->description();
  FrameExchange exchange(camera->format(), 8);
  camera->start(exchange);
  ASSERT_TRUE(device_->wait_until_acquiring());
  stream(exchange, 1, 200);
  camera->stop();
  EXPECT_EQ(camera->counts().delivered, 199);
  EXPECT_EQ(camera->counts().dropped(), 0);
  EXPECT_EQ(camera->failure(), "");
}

TEST_F(UsbVision, WhatFollowsTheRowsIsNotTakenForPixels) {
  device_ = std::make_unique<EmulatedVisionCamera>(kRows, kCols, 12);
  plug();
  const auto camera = open();
  FrameExchange exchange(camera->format(), 8);
  camera->start(exchange);
  ASSERT_TRUE(device_->wait_until_acquiring());
  stream(exchange, 1, 10);
  camera->stop();
  EXPECT_EQ(camera->counts().delivered, 9);
}

// Rows would be looked for far behind the frame. They are taken to follow each other instead.
TEST_F(UsbVision, PaddingThatAFrameHasNoRoomForIsNotThere) {
  constexpr int kPadding = 12;
  device_ = std::make_unique<EmulatedVisionCamera>(kRows, kCols, kPadding);
  plug();
  const auto camera = open();
  FrameExchange exchange(camera->format(), 8);
  camera->start(exchange);
  ASSERT_TRUE(device_->wait_until_acquiring());
  stream(exchange, 1, 10);
  const auto pixels = vision_pixels(10);
  for (const int padding : {kPadding + 2, 0xFFFF}) {
    SCOPED_TRACE(padding);
    device_->claim_padding(padding);
    ASSERT_TRUE(device_->send_frame(10, pixels));
    FrameBuffer* frame = exchange.take(kLong_us);
    ASSERT_NE(frame, nullptr);
    const auto* got = frame->view().data<std::uint16_t>();
    EXPECT_TRUE(std::equal(got, got + kCols, pixels.begin()));
    EXPECT_EQ(got[kCols], 0xEEEE) << "that is the padding of the first row";
    EXPECT_TRUE(std::equal(got + kCols + kPadding / 2, got + 2 * kCols, pixels.begin() + kCols));
    exchange.give_back(frame);
  }
  camera->stop();
}

// Aravis says by this number that a frame has none.
TEST_F(UsbVision, AFrameWithoutANumberIsNotDelivered) {
  plug();
  const auto camera = open();
  FrameExchange exchange(camera->format(), 8);
  camera->start(exchange);
  ASSERT_TRUE(device_->wait_until_acquiring());
  stream(exchange, 1, 10);
  ASSERT_TRUE(device_->send_frame(std::numeric_limits<std::uint64_t>::max(), vision_pixels(0)));
  EXPECT_EQ(exchange.take(kLong_us / 20), nullptr);
  EXPECT_EQ(camera->counts().other, 1);
  for (std::uint64_t id = 11; id < 13; ++id) {
    ASSERT_TRUE(device_->send_frame(id, vision_pixels(id)));
    FrameBuffer* frame = exchange.take(kLong_us);
    ASSERT_NE(frame, nullptr);
    EXPECT_EQ(frame->header.sequence, static_cast<std::int64_t>(id));
    EXPECT_FALSE(frame->header.renumbered);
    EXPECT_EQ(frame->header.status, id == 11 ? kFrameGapBefore : kFrameOk);
    exchange.give_back(frame);
  }
  camera->stop();
  EXPECT_EQ(camera->counts().delivered, 11);
  EXPECT_EQ(camera->counts().dropped(), 1);
}

TEST_F(UsbVision, UnpluggedInMidFrameAndPluggedInAgain) {
  for (int round = 0; round < 4; ++round) {
    SCOPED_TRACE("round " + std::to_string(round));
    plug();
    const auto camera = open();
    FrameExchange exchange(camera->format(), 8);
    camera->start(exchange);
    ASSERT_TRUE(device_->wait_until_acquiring());
    stream(exchange, 1, 10);
    ASSERT_TRUE(device_->send_part_of_frame(10, vision_pixels(10), 4096));
    device_->unplug();
    const auto before = std::chrono::steady_clock::now();
    while (!exchange.closed() &&
           std::chrono::steady_clock::now() - before < std::chrono::seconds(10)) {
      EXPECT_EQ(exchange.take(1000), nullptr) << "half a frame was delivered";
    }
    EXPECT_TRUE(exchange.closed());
    EXPECT_NE(camera->failure().find("Curlew Works Vision 1"), std::string::npos)
        << camera->failure();
    camera->stop();
    EXPECT_EQ(camera->counts().delivered, 9);
    EXPECT_NE(failure_text([] { open(); }).find("aravis:"), std::string::npos);
  }
}

}  // namespace
}  // namespace curlew
