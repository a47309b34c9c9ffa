// These tests do to frames what networks and cameras do: packets get lost, and cameras die.
#include <gtest/gtest.h>

#include <filesystem>
#include <thread>

#include "core/error.h"
#include "tests/acquisition/aravis/served_camera.h"

namespace curlew {
namespace {

using Clock = std::chrono::steady_clock;

class PacketLoss : public ServedCamera, public testing::WithParamInterface<double> {};

TEST_P(PacketLoss, IncompleteFramesAreCountedAndNeverDelivered) {
  const KnownImages images = known_images(512, 512, kMono16);  // A frame is some 380 packets.
  FakeGigeOptions served;
  served.frame_rate_hz = 100;
  const auto server = serve(images, served);
  const auto camera = open(packets(1400));
  FrameExchange exchange(camera->format(), 8);
  std::int64_t last = FakeGigeCamera::kFirstNumber - 1;
  std::int64_t missing = 0;  // numbers between the frames that were taken
  bool gap_expected = false;
  const auto take = [&](std::int64_t timeout_us) {
    FrameBuffer* frame = exchange.take(timeout_us);
    if (frame == nullptr) return false;
    const FrameHeader& header = frame->header;
    EXPECT_TRUE(images.shows(frame->view(), header.sequence)) << "frame " << header.sequence;
    missing += header.sequence - last - 1;
    // A frame that says that there is a gap before it must have one. The converse holds only if no
    // frame was superseded.
    EXPECT_TRUE((header.status & kFrameGapBefore) == 0 || header.sequence > last + 1);
    if (exchange.superseded() == 0 && header.sequence > last + 1) {
      EXPECT_NE(header.status & kFrameGapBefore, 0U);
      gap_expected = true;
    }
    last = header.sequence;
    exchange.give_back(frame);
    return true;
  };

  camera->start(exchange);
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(take(10'000'000));
  server->set_lost_packet_ratio(GetParam());
  const std::int64_t begin = server->frames_sent();
  while (server->frames_sent() < begin + 200) take(100'000);
  server->set_lost_packet_ratio(0);
  // The last frames are whole, so that the last number is known.
  const std::int64_t quiet = server->frames_sent() + 3;
  while (server->frames_sent() < quiet + 3) take(100'000);
  camera->stop();
  take(0);

  const FrameCounts counts = camera->counts();
  EXPECT_GT(counts.incomplete + counts.timed_out + counts.lost, 0);
  EXPECT_EQ(counts.delivered, exchange.delivered());
  EXPECT_EQ(total(counts) - counts.aborted, last - FakeGigeCamera::kFirstNumber + 1);
  EXPECT_EQ(missing, counts.dropped() - counts.aborted + exchange.superseded());
  EXPECT_TRUE(gap_expected || exchange.superseded() > 0);
  EXPECT_EQ(counts.other, 0);
  EXPECT_EQ(counts.wrong_size, 0);
}

INSTANTIATE_TEST_SUITE_P(Aravis, PacketLoss, testing::Values(0.0005, 0.01));

using AravisLoss = ServedCamera;

/// Waits until the camera closes the exchange; returns false if it does not.
bool wait_until_closed(FrameExchange& exchange) {
  const auto deadline = Clock::now() + std::chrono::seconds(60);
  while (!exchange.closed() && Clock::now() < deadline) {
    if (FrameBuffer* frame = exchange.take(100'000)) exchange.give_back(frame);
  }
  return exchange.closed();
}

TEST_F(AravisLoss, CameraThatDiesClosesTheExchangeAndSaysSo) {
  const KnownImages images = known_images(64, 64, kMono16);
  auto server = serve(images);
  auto camera = open();
  FrameExchange exchange(camera->format(), 8);
  Taker taker(exchange, images);
  camera->start(exchange);
  ASSERT_TRUE(taker.take(10));
  server.reset();
  ASSERT_TRUE(wait_until_closed(exchange));
  EXPECT_NE(camera->failure().find("Aravis Fake, serial number CURLEW, 127.0.0.1 is lost"),
            std::string::npos)
      << camera->failure();
  const auto begin = Clock::now();
  camera->stop();
  camera.reset();
  // Aravis alone would wait 5 s for answers.
  EXPECT_LT(Clock::now() - begin, std::chrono::seconds(4));

  server = serve(images);
  camera = open();
  FrameExchange again(camera->format(), 8);
  Taker next(again, images);
  camera->start(again);
  EXPECT_TRUE(next.take(10));
  camera->stop();
}

TEST_F(AravisLoss, StopDoesNotWaitForACameraThatJustDied) {
  const KnownImages images = known_images(64, 64, kMono16);
  for (const bool start_again : {false, true}) {
    auto server = serve(images);
    auto camera = open();
    FrameExchange exchange(camera->format(), 8);
    Taker taker(exchange, images);
    camera->start(exchange);
    ASSERT_TRUE(taker.take(3));
    server.reset();
    const auto begin = Clock::now();
    camera->stop();
    EXPECT_LT(Clock::now() - begin, std::chrono::seconds(4));
    if (start_again) {  // It must be refused, and put everything back.
      EXPECT_THROW(camera->start(exchange), Failure);
      while (FrameBuffer* waiting = exchange.take(0)) exchange.give_back(waiting);
      std::size_t back = 0;
      while (exchange.empty() != nullptr) ++back;
      EXPECT_EQ(back, exchange.buffers());
    }
  }
}

// What a dead camera leaves behind must end by itself, so that no thread stays.
TEST_F(AravisLoss, NoThreadOfADeadCameraStays) {
  const KnownImages images = known_images(64, 64, kMono16);
  const auto threads = [] {
    const std::filesystem::directory_iterator tasks("/proc/self/task");
    return std::distance(begin(tasks), end(tasks));
  };
  std::ptrdiff_t before = 0;
  for (int round = 0; round < 4; ++round) {
    auto server = serve(images);
    auto camera = open();
    FrameExchange exchange(camera->format(), 8);
    Taker taker(exchange, images);
    camera->start(exchange);
    ASSERT_TRUE(taker.take(3));
    if (round > 0) server.reset();
    camera.reset();
    server.reset();
    if (round == 0) before = threads();  // GLib keeps some threads of its own.
  }
  const auto deadline = Clock::now() + std::chrono::seconds(60);
  while (threads() > before && Clock::now() < deadline)
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  EXPECT_LE(threads(), before);
}

}  // namespace
}  // namespace curlew
