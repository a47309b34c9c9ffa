// These tests stream, damage, unplug, plug in again and refuse an emulated plain bulk camera.
#include "acquisition/usb/usb_camera.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <chrono>
#include <filesystem>
#include <functional>
#include <future>
#include <thread>

#include "acquisition/usb/usb_devices.h"
#include "acquisition/usb/usb_watcher.h"
#include "core/error.h"
#include "tests/acquisition/usb/emulated_usb.h"
#include "tests/acquisition/usb/usb_stream.h"
#include "tests/support/failure_text.h"

namespace curlew {
namespace {

constexpr std::uint16_t kVendor = 0x1d50;
constexpr std::uint16_t kProduct = 0x60a1;
constexpr int kEndpoint = 0x82;
constexpr std::int64_t kLong_us = 10'000'000;

/// Describes a camera with one interface of a vendor's own: bulk IN 0x82 of 512 bytes in alternate
/// setting 0.
UsbIdentity bulk_camera() {
  return {
      kVendor,
      kProduct,
      "Curlew Works",
      "Bulk 1",
      "B0001",
      512,
      {18, 1, 0,         2, 0, 0,    0, 64,   0x50, 0x1d, 0xa1, 0x60, 0, 1, 1, 2, 3, 1,  // device
       9,  2, 25,        0, 1, 1,    0, 0x80, 250,  // configuration
       9,  4, 0,         0, 1, 0xff, 0, 0,    0,    // interface
       7,  5, kEndpoint, 2, 0, 2,    0}};           // endpoint
}

CameraOptions options(UsbLayout layout) {
  layout.endpoint = kEndpoint;
  layout.transfer_bytes = 4096;
  layout.transfers = 8;
  CameraOptions options;
  options.usb = layout;
  return options;
}

class UsbCamera : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!usb_can_be_emulated()) GTEST_SKIP() << "run it under umockdev-wrapper";
    device_ = std::make_unique<EmulatedUsbDevice>(bulk_camera());
  }

  static std::unique_ptr<Camera> open(const UsbLayout& layout, const ThreadStart& start = {}) {
    return open_usb_camera(kVendor, kProduct, options(layout), start);
  }

  /// Sends frames [from, to). `got` takes each one before the next is sent.
  void stream(const UsbLayout& layout, FrameExchange& exchange, std::uint32_t from,
              std::uint32_t to, const std::function<void(std::uint32_t, FrameBuffer*)>& got) {
    for (std::uint32_t n = from; n < to; ++n) {
      ASSERT_TRUE(device_->send(kEndpoint, stream_frame(layout, n), true));
      FrameBuffer* frame = exchange.take(kLong_us);
      ASSERT_NE(frame, nullptr) << "frame " << n;
      got(n, frame);
      exchange.give_back(frame);
    }
  }

  std::unique_ptr<EmulatedUsbDevice> device_;
};

int threads_of_this_process() {
  return static_cast<int>(std::distance(std::filesystem::directory_iterator("/proc/self/task"),
                                        std::filesystem::directory_iterator()));
}

TEST_F(UsbCamera, StreamsEveryPixel) {
  device_->plug();
  const UsbLayout layout = stream_layout();
  std::atomic<int> thread_starts{0};
  const auto camera = open(layout, [&] { ++thread_starts; });
  EXPECT_EQ(camera->format().rows, 12);
  EXPECT_EQ(camera->format().cols, 20);
  EXPECT_NE(camera->description().find("Curlew Works Bulk 1 serial number B0001"),
            std::string::npos)
      << camera->description();
  FrameExchange exchange(camera->format(), 4);
  camera->start(exchange);
  stream(layout, exchange, 0, 200, [&](std::uint32_t n, FrameBuffer* buffer) {
    const Delivered frame = copy_of(*buffer);
    EXPECT_EQ(frame.sequence, n);
    EXPECT_EQ(frame.renumbered, n == 0);
    EXPECT_EQ(frame.status, kFrameOk);
    EXPECT_EQ(frame.pixels, stream_pixels(layout, n));
    EXPECT_EQ(buffer->header.camera_ns, 0);
    EXPECT_GT(buffer->header.received_ns, 0);
    EXPECT_LE(buffer->header.received, std::chrono::steady_clock::now());
    EXPECT_EQ(buffer->rows_ready.load(), 12);
  });
  camera->stop();
  EXPECT_EQ(thread_starts, 1);
  EXPECT_EQ(camera->counts().delivered, 200);
  EXPECT_EQ(camera->counts().dropped(), 0);
  EXPECT_EQ(camera->failure(), "");
  EXPECT_FALSE(exchange.closed());
  EXPECT_EQ(device_->opened_transfers(), 0);
}

TEST_F(UsbCamera, FramesLargerThanATransferAndWithoutSync) {
  device_->plug();
  UsbLayout layout = stream_layout(8, false, false);
  layout.rows = 128;
  layout.cols = 160;  // With header and trailer it is five transfers and a bit.
  const auto camera = open(layout);
  FrameExchange exchange(camera->format(), 4);
  camera->start(exchange);
  stream(layout, exchange, 0, 30, [&](std::uint32_t n, FrameBuffer* buffer) {
    EXPECT_EQ(buffer->header.sequence, n);
    EXPECT_EQ(copy_of(*buffer).pixels, stream_pixels(layout, n));
  });
  // A frame that is a whole number of packets must end with an empty one.
  camera->stop();
  layout.header_bytes = 0;
  layout.trailer_bytes = 0;
  ASSERT_EQ(usb_frame_bytes(layout) % 4096, 0U);
  const auto again = open(layout);
  FrameExchange other(again->format(), 4);
  again->start(other);
  stream(layout, other, 0, 10, [&](std::uint32_t n, FrameBuffer* buffer) {
    EXPECT_EQ(copy_of(*buffer).pixels, stream_pixels(layout, n));
  });
  EXPECT_EQ(again->counts().dropped(), 0);
}

TEST_F(UsbCamera, CutAndCorruptedFramesAreCountedAndNeverDelivered) {
  device_->plug();
  const UsbLayout layout = stream_layout();
  const auto camera = open(layout);
  FrameExchange exchange(camera->format(), 4);
  camera->start(exchange);
  std::int64_t first = -1;
  std::int64_t last = -1;
  std::int64_t taken = 0;
  for (std::uint32_t n = 10; n < 110; ++n) {
    Bytes frame = stream_frame(layout, n);
    if (n % 10 == 3) frame.resize(frame.size() / 2);
    if (n % 10 == 5) frame[1] ^= 0xff;
    if (n % 10 == 7) frame.insert(frame.end(), 30, 0);
    ASSERT_TRUE(device_->send(kEndpoint, frame, true));
    if (n % 10 == 3 || n % 10 == 5 || n % 10 == 7) continue;
    FrameBuffer* buffer = exchange.take(kLong_us);
    ASSERT_NE(buffer, nullptr);
    EXPECT_EQ(buffer->header.sequence, n);
    EXPECT_EQ(buffer->header.status, n % 10 == 4 || n % 10 == 6 || n % 10 == 8
                                         ? static_cast<std::uint32_t>(kFrameGapBefore)
                                         : static_cast<std::uint32_t>(kFrameOk));
    EXPECT_EQ(copy_of(*buffer).pixels, stream_pixels(layout, n));
    if (first < 0) first = buffer->header.sequence;
    last = buffer->header.sequence;
    ++taken;
    exchange.give_back(buffer);
  }
  camera->stop();
  const FrameCounts counts = camera->counts();
  EXPECT_EQ(counts.delivered, taken);
  EXPECT_EQ(counts.incomplete, 10);
  EXPECT_EQ(counts.lost, 10);  // These are the frames without their sync.
  EXPECT_EQ(counts.wrong_size, 10);
  EXPECT_EQ(last - first + 1, counts.delivered + counts.dropped());
}

TEST_F(UsbCamera, FramesNobodyHasABufferForAreLostAndTheStreamGoesOn) {
  device_->plug();
  const UsbLayout layout = stream_layout();
  const auto camera = open(layout);
  FrameExchange exchange(camera->format(), 2);
  camera->start(exchange);
  std::vector<FrameBuffer*> held;
  ASSERT_TRUE(device_->send(kEndpoint, stream_frame(layout, 0), true));
  held.push_back(exchange.take(kLong_us));
  ASSERT_NE(held[0], nullptr);
  ASSERT_TRUE(device_->send(kEndpoint, stream_frame(layout, 1), true));
  held.push_back(exchange.take(kLong_us));
  ASSERT_NE(held[1], nullptr);
  for (std::uint32_t n = 2; n < 20; ++n) {
    ASSERT_TRUE(device_->send(kEndpoint, stream_frame(layout, n), true));
  }
  ASSERT_TRUE(device_->drained());
  for (int i = 0; i < 2000 && camera->counts().no_buffer < 18; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  EXPECT_EQ(camera->counts().no_buffer, 18);
  for (FrameBuffer* frame : held) exchange.give_back(frame);
  ASSERT_TRUE(device_->send(kEndpoint, stream_frame(layout, 20), true));
  FrameBuffer* frame = exchange.take(kLong_us);
  ASSERT_NE(frame, nullptr);
  EXPECT_EQ(frame->header.sequence, 20);
  EXPECT_EQ(frame->header.status, kFrameGapBefore);
  camera->stop();
  EXPECT_EQ(camera->counts().lost, 18);
  EXPECT_EQ(camera->counts().delivered, 3);
}

TEST_F(UsbCamera, UnpluggedInMidFrameAndPluggedInAgain) {
  const UsbLayout layout = stream_layout();
  std::atomic<int> arrivals{0};
  std::atomic<int> departures{0};
  const UsbWatcher watcher(
      [&](UsbChange change) { ++(change == UsbChange::kArrived ? arrivals : departures); });
  ASSERT_TRUE(watcher.notices());
  int threads = 0;
  for (int round = 0; round < 8; ++round) {
    SCOPED_TRACE("round " + std::to_string(round));
    device_->plug();
    for (int i = 0; i < 2000 && arrivals != round + 1; ++i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    ASSERT_EQ(arrivals, round + 1);
    const auto camera = open(layout);
    FrameExchange exchange(camera->format(), 4);
    camera->start(exchange);
    stream(layout, exchange, 0, 10, [](std::uint32_t, FrameBuffer*) {});
    const Bytes frame = stream_frame(layout, 10);
    ASSERT_TRUE(device_->send(kEndpoint, std::span(frame).first(frame.size() / 2), round % 2 == 0));
    ASSERT_TRUE(device_->drained());
    device_->unplug();
    const auto before = std::chrono::steady_clock::now();
    while (!exchange.closed() &&
           std::chrono::steady_clock::now() - before < std::chrono::seconds(10)) {
      EXPECT_EQ(exchange.take(1000), nullptr);
    }
    EXPECT_TRUE(exchange.closed());
    EXPECT_NE(camera->failure().find("usb:1d50:60a1: it was unplugged"), std::string::npos)
        << camera->failure();
    camera->stop();
    EXPECT_EQ(camera->counts().delivered, 10);
    EXPECT_EQ(camera->counts().aborted, 1);
    EXPECT_EQ(camera->counts().dropped(), 1);
    for (int i = 0; i < 2000 && departures != round + 1; ++i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    ASSERT_EQ(departures, round + 1);
    EXPECT_NE(failure_text([&] { open(layout); }).find("no such USB device is attached"),
              std::string::npos);
    if (round == 0) threads = threads_of_this_process();
  }
  EXPECT_EQ(threads_of_this_process(), threads);
}

TEST_F(UsbCamera, UnpluggedAtRandomMomentsAlsoInOpeningAndStopping) {
  const unsigned seed = std::random_device{}();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  const UsbLayout layout = stream_layout();
  // This keeps libusb's socket for news open, because umockdev aborts if one closes while it sends.
  const UsbWatcher watcher([](UsbChange) {});
  int opened = 0;
  for (unsigned round = 0; round < 20 || (opened == 0 && round < 200); ++round) {
    device_->plug();
    std::thread sender([&] {
      for (std::uint32_t n = 0; device_->send(kEndpoint, stream_frame(layout, n), true); ++n) {
        std::this_thread::sleep_for(std::chrono::microseconds(200));
      }
    });
    // A machine that is slow to open the camera gets more time after twenty rounds.
    const auto delay = std::chrono::microseconds(random() % (15000 * (1 + round / 20)));
    std::thread hand([&] {
      std::this_thread::sleep_for(delay);
      device_->unplug();
    });
    try {
      const auto camera = open(layout);
      FrameExchange exchange(camera->format(), 4);
      camera->start(exchange);
      ++opened;
      const auto until =
          std::chrono::steady_clock::now() + std::chrono::milliseconds(random() % 20);
      std::int64_t first = -1;
      std::int64_t last = -1;
      while (std::chrono::steady_clock::now() < until && !exchange.closed()) {
        FrameBuffer* frame = exchange.take(1000);
        if (frame == nullptr) continue;
        EXPECT_EQ(copy_of(*frame).pixels,
                  stream_pixels(layout, static_cast<std::uint32_t>(frame->header.sequence)));
        if (first < 0) first = frame->header.sequence;
        last = frame->header.sequence;
        exchange.give_back(frame);
      }
      const auto before = std::chrono::steady_clock::now();
      camera->stop();
      EXPECT_LT(std::chrono::steady_clock::now() - before, std::chrono::seconds(5));
      EXPECT_LE(last < 0 ? 0 : last - first + 1, camera->counts().delivered);
    } catch (const Failure& failure) {
      EXPECT_NE(std::string(failure.what()).find("usb:1d50:60a1"), std::string::npos)
          << failure.what();
    }
    hand.join();
    sender.join();
  }
  EXPECT_GT(opened, 0);
}

TEST_F(UsbCamera, AStalledEndpointEndsTheStreamWithItsReason) {
  device_->plug();
  const UsbLayout layout = stream_layout();
  const auto camera = open(layout);
  FrameExchange exchange(camera->format(), 4);
  camera->start(exchange);
  stream(layout, exchange, 0, 3, [](std::uint32_t, FrameBuffer*) {});
  device_->break_transfers(kEndpoint, -EPIPE);
  for (int i = 0; i < 10000 && !exchange.closed(); ++i) EXPECT_EQ(exchange.take(1000), nullptr);
  EXPECT_TRUE(exchange.closed());
  EXPECT_NE(camera->failure().find("stalled"), std::string::npos) << camera->failure();
  camera->stop();
  // The same camera must start again.
  FrameExchange other(camera->format(), 4);
  camera->start(other);
  stream(layout, other, 3, 6, [](std::uint32_t, FrameBuffer*) {});
  EXPECT_EQ(camera->failure(), "");
}

TEST_F(UsbCamera, SaysWhyItCannotBeOpened) {
  device_->plug();
  const UsbLayout layout = stream_layout();
  EXPECT_NE(failure_text([&] {
              open_usb_camera(0x1234, 0x5678, options(layout), {});
            }).find("usb:1234:5678: no such USB device is attached; 'curlew cameras'"),
            std::string::npos);
  device_->busy = true;
  const std::string in_use = failure_text([&] { open(layout); });
  EXPECT_NE(in_use.find("interface 0 is in use by another program"), std::string::npos) << in_use;
  device_->busy = false;

  const auto usage_text = [&](auto&& change) {
    CameraOptions wrong = options(layout);
    change(wrong.usb);
    try {
      open_usb_camera(kVendor, kProduct, wrong, {});
    } catch (const UsageError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  const std::string rows = usage_text([](UsbLayout& l) { l.rows = 0; });
  EXPECT_NE(rows.find("[usb] rows = 0"), std::string::npos) << rows;
  const std::string endpoint = usage_text([](UsbLayout& l) { l.endpoint = 0x83; });
  EXPECT_NE(endpoint.find("no bulk IN endpoint 0x83"), std::string::npos) << endpoint;
  EXPECT_NE(endpoint.find("endpoint = 0x82"), std::string::npos) << endpoint;
  const std::string size = usage_text([](UsbLayout& l) { l.transfer_bytes = 1000; });
  EXPECT_NE(size.find("[usb] transfers = 8 and transfer_bytes = 1000"), std::string::npos) << size;
}

TEST_F(UsbCamera, TheKernelsMemoryLimitIsExplained) {
  device_->plug();
  device_->memory_limit_bytes = 5 * 4096;
  const auto camera = open(stream_layout());
  FrameExchange exchange(camera->format(), 4);
  const std::string text = failure_text([&] { camera->start(exchange); });
  EXPECT_NE(text.find("8 transfers of 4096 bytes"), std::string::npos) << text;
  EXPECT_NE(text.find("usbfs_memory_mb"), std::string::npos) << text;
  EXPECT_EQ(device_->opened_transfers(), 0);  // Transfers that found room were taken back.
  device_->memory_limit_bytes = 1 << 20;
  camera->start(exchange);
  stream(stream_layout(), exchange, 0, 3, [](std::uint32_t, FrameBuffer*) {});
}

/// Lets the process do only what an ordinary user may, as long as it lives.
class OrdinaryUser {
 public:
  OrdinaryUser() : changed_(::geteuid() == 0 && ::seteuid(65534) == 0) {}
  ~OrdinaryUser() {
    if (changed_ && ::seteuid(0) != 0) std::abort();
  }
  OrdinaryUser(const OrdinaryUser&) = delete;
  OrdinaryUser& operator=(const OrdinaryUser&) = delete;

 private:
  bool changed_;
};

TEST_F(UsbCamera, AMissingPermissionIsExplainedWithTheRuleThatCuresIt) {
  device_->plug();
  ASSERT_EQ(list_usb_cameras().size(), 1U);
  EXPECT_EQ(list_usb_cameras()[0].problem, "");
  EXPECT_EQ(list_usb_cameras()[0].source, "usb:1d50:60a1");
  const std::string root = EmulatedUsb::instance().root();
  // umockdev makes sockets here, and connects to the device's socket even if open() failed.
  ASSERT_EQ(::chmod(root.c_str(), 0777), 0);
  ASSERT_EQ(::chmod((root + "/ioctl/" + device_->node()).c_str(), 0777), 0);
  ASSERT_EQ(::chmod(device_->node().c_str(), 0), 0);
  const OrdinaryUser user;
  const std::vector<CameraListing> cameras = list_usb_cameras();
  ASSERT_EQ(cameras.size(), 1U);
  const std::string& problem = cameras[0].problem;
  EXPECT_NE(problem.find(device_->node() + " may not be opened by this user"), std::string::npos)
      << problem;
  EXPECT_NE(problem.find("/usr/lib/udev/rules.d/70-curlew-cameras.rules"), std::string::npos);
  EXPECT_NE(problem.find("1d50:60a1"), std::string::npos);
  EXPECT_NE(failure_text([&] { open(stream_layout()); }).find(problem), std::string::npos);
  const std::vector<std::string> advice = usb_advice(stream_layout());
  EXPECT_NE(std::find(advice.begin(), advice.end(), "usb:1d50:60a1: " + problem), advice.end());
}

TEST_F(UsbCamera, WorksWhereThereIsNoUsb) {
  EXPECT_TRUE(list_usb_cameras().empty());
  const UsbWatcher watcher([](UsbChange) { ADD_FAILURE() << "nothing changed"; });
  EXPECT_NE(failure_text([&] { open(stream_layout()); }).find("no such USB device"),
            std::string::npos);
}

}  // namespace
}  // namespace curlew
