// These tests stream from a GigE Vision camera served on loopback. They check what arrives, and
// what is said of it.
#include "acquisition/aravis/aravis_camera.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <thread>

#include "tests/acquisition/aravis/served_camera.h"
#include "tests/support/failure_text.h"

namespace curlew {
namespace {

constexpr std::size_t kBuffers = 8;

bool has_note(const Camera& camera, const std::string& text) {
  const auto notes = camera.notes();
  return std::any_of(notes.begin(), notes.end(),
                     [&](const std::string& note) { return note.find(text) != std::string::npos; });
}

int threads_of_this_process() {
  const std::filesystem::directory_iterator tasks("/proc/self/task");
  return static_cast<int>(std::distance(begin(tasks), end(tasks)));
}

struct Coding {
  const char* name;
  std::uint32_t code;
};

class EveryPixelFormat : public ServedCamera, public testing::WithParamInterface<Coding> {};

// Within these 200 frames the numbers wrap from 65535 to 1.
TEST_P(EveryPixelFormat, EveryPixelArrivesAndTheNumbersCountOn) {
  const KnownImages images = known_images(48, 68, GetParam().code);
  FakeGigeOptions served;
  served.pixel_format = GetParam().name;
  served.frame_rate_hz = 500;
  const auto server = serve(images, served);
  const auto camera = open();
  EXPECT_EQ(camera->format().rows, 48);
  EXPECT_EQ(camera->format().cols, 68);
  EXPECT_EQ(camera->format().pixel_type, images.type);

  FrameExchange exchange(camera->format(), kBuffers);
  Taker taker(exchange, images);
  camera->start(exchange);
  ASSERT_TRUE(taker.take(200)) << camera->failure();
  camera->stop();
  taker.take_one(0);

  const FrameCounts counts = camera->counts();
  EXPECT_GT(taker.last, 65535);
  EXPECT_EQ(counts.lost, 0);
  EXPECT_EQ(counts.delivered, taker.last - FakeGigeCamera::kFirstNumber + 1);
  EXPECT_EQ(counts.dropped(), counts.aborted);  // stop() may abort the last one.
  EXPECT_LE(counts.aborted, 1);
  EXPECT_EQ(counts.delivered, taker.taken + exchange.superseded());
  EXPECT_EQ(camera->failure(), "");
}

INSTANTIATE_TEST_SUITE_P(Aravis, EveryPixelFormat,
                         testing::Values(Coding{"Mono8", kMono8}, Coding{"Mono10", 0x01100003},
                                         Coding{"Mono10p", 0x010A0046},
                                         Coding{"Mono10Packed", 0x010C0004},
                                         Coding{"Mono12", kMono12}, Coding{"Mono12p", 0x010C0047},
                                         Coding{"Mono12Packed", 0x010C0006},
                                         Coding{"Mono14", 0x01100025}, Coding{"Mono16", kMono16}),
                         [](const auto& instance) { return instance.param.name; });

using AravisCamera = ServedCamera;

TEST_F(AravisCamera, DescribesItself) {
  const KnownImages images = known_images(16, 16, kMono16);
  FakeGigeOptions served;
  served.serial = "SH042";
  const auto server = serve(images, served);
  EXPECT_EQ(open()->description(), "Aravis Fake, serial number SH042, 127.0.0.1");
}

TEST_F(AravisCamera, CallsThreadStartInTheThreadThatReceives) {
  const KnownImages images = known_images(16, 16, kMono16);
  const auto server = serve(images);
  std::atomic<int> calls{0};
  std::thread::id receiving;
  const auto camera = open_aravis_camera("127.0.0.1", packets(), [&] {
    receiving = std::this_thread::get_id();
    ++calls;
  });
  EXPECT_EQ(calls, 0);
  FrameExchange exchange(camera->format(), kBuffers);
  Taker taker(exchange, images);
  camera->start(exchange);
  ASSERT_TRUE(taker.take(3));
  camera->stop();
  EXPECT_EQ(calls, 1);
  EXPECT_NE(receiving, std::this_thread::get_id());
}

TEST_F(AravisCamera, RegionIsTheCutOut) {
  const KnownImages whole = known_images(40, 60, kMono16);
  const auto server = serve(whole);
  CameraOptions options = packets();
  options.x_px = 12;
  options.y_px = 7;
  options.width_px = 20;
  options.height_px = 30;
  const auto camera = open(options);
  EXPECT_EQ(camera->format().offset_x_px, 12);
  EXPECT_EQ(camera->format().offset_y_px, 7);
  KnownImages region{30, 20, PixelType::kU16, {}, {}};
  for (const auto& image : whole.counts) {
    region.counts.emplace_back();
    for (std::size_t r = 7; r < 37; ++r)
      for (std::size_t c = 12; c < 32; ++c) region.counts.back().push_back(image[r * 60 + c]);
  }
  FrameExchange exchange(camera->format(), kBuffers);
  Taker taker(exchange, region);
  camera->start(exchange);
  EXPECT_TRUE(taker.take(20));
  camera->stop();
}

TEST_F(AravisCamera, SlowConsumerGetsTheNewestAndTheRestIsCounted) {
  const KnownImages images = known_images(64, 64, kMono16);
  FakeGigeOptions served;
  served.frame_rate_hz = 500;
  const auto server = serve(images, served);
  const auto camera = open();
  // There may not be fewer buffers: one is with the pipeline, one waits, and one is being filled.
  FrameExchange exchange(camera->format(), 3);
  Taker taker(exchange, images);
  camera->start(exchange);
  for (int i = 0; i < 40; ++i) {
    FrameBuffer* frame = exchange.take(10'000'000);
    ASSERT_NE(frame, nullptr);
    std::this_thread::sleep_for(std::chrono::milliseconds(15));
    EXPECT_TRUE(images.shows(frame->view(), frame->header.sequence));  // Nobody may write into it.
    ++taker.taken;
    exchange.give_back(frame);
  }
  camera->stop();
  taker.take_one(0);
  EXPECT_EQ(exchange.delivered(), taker.taken + exchange.superseded());
  EXPECT_EQ(camera->counts().delivered, exchange.delivered());
  EXPECT_GT(exchange.superseded(), 40);
  EXPECT_EQ(camera->counts().no_buffer, 0);
}

// With packed pixels the stream has buffers of its own.
TEST_F(AravisCamera, SlowConsumerOfPackedPixels) {
  const KnownImages images = known_images(64, 64, 0x010C0047);
  FakeGigeOptions served;
  served.pixel_format = "Mono12p";
  served.frame_rate_hz = 500;
  const auto server = serve(images, served);
  const auto camera = open();
  FrameExchange exchange(camera->format(), 3);
  Taker taker(exchange, images);
  camera->start(exchange);
  for (int i = 0; i < 20; ++i) {
    ASSERT_TRUE(taker.take(1));
    std::this_thread::sleep_for(std::chrono::milliseconds(15));
  }
  camera->stop();
  taker.take_one(0);
  EXPECT_EQ(exchange.delivered(), taker.taken + exchange.superseded());
  EXPECT_GT(exchange.superseded(), 20);
  EXPECT_EQ(camera->counts().no_buffer, 0);
}

// Here the pipeline holds every buffer. Frames for which there is none must be lost and counted so,
// and the stream must go on when the pipeline gives the buffers back.
TEST_F(AravisCamera, FramesWithoutABufferAreCountedAndTheStreamGoesOn) {
  for (const Coding& coding : {Coding{"Mono12", kMono12}, Coding{"Mono12p", 0x010C0047}}) {
    SCOPED_TRACE(coding.name);
    const KnownImages images = known_images(64, 64, coding.code);
    FakeGigeOptions served;
    served.pixel_format = coding.name;
    served.frame_rate_hz = 500;
    const auto server = serve(images, served);
    const auto camera = open();
    FrameExchange exchange(camera->format(), 4);
    camera->start(exchange);
    std::vector<FrameBuffer*> held;
    for (int i = 0; i < 4; ++i) held.push_back(exchange.take(10'000'000));
    const std::int64_t begin = server->frames_sent();
    while (server->frames_sent() < begin + 30)
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    Taker taker(exchange, images);
    for (FrameBuffer* frame : held) {
      ASSERT_NE(frame, nullptr);
      exchange.give_back(frame);
    }
    EXPECT_TRUE(taker.take(50));
    camera->stop();
    taker.take_one(0);
    const FrameCounts counts = camera->counts();
    EXPECT_GT(counts.no_buffer, 20);
    EXPECT_EQ(counts.lost, counts.no_buffer);
    EXPECT_EQ(total(counts) - counts.aborted, taker.last - FakeGigeCamera::kFirstNumber + 1);
    EXPECT_EQ(exchange.delivered(), taker.taken + 4 + exchange.superseded());
  }
}

TEST_F(AravisCamera, StopsAndStartsAgain) {
  const KnownImages images = known_images(64, 64, kMono16);
  FakeGigeOptions served;
  served.frame_rate_hz = 500;
  const auto server = serve(images, served);
  const auto camera = open();
  FrameExchange exchange(camera->format(), kBuffers);
  const int threads = threads_of_this_process();
  std::int64_t last = -1;
  for (int round = 0; round < 10; ++round) {
    SCOPED_TRACE(testing::Message() << "round " << round);
    camera->start(exchange);
    FrameBuffer* first = exchange.take(10'000'000);
    ASSERT_NE(first, nullptr);
    EXPECT_GT(first->header.sequence, last);
    last = first->header.sequence;
    exchange.give_back(first);
    for (int i = 0; i < 5; ++i) {
      FrameBuffer* frame = exchange.take(10'000'000);
      ASSERT_NE(frame, nullptr);
      EXPECT_FALSE(frame->header.renumbered);
      last = frame->header.sequence;
      exchange.give_back(frame);
    }
    camera->stop();
    while (FrameBuffer* waiting = exchange.take(0)) exchange.give_back(waiting);
    EXPECT_EQ(threads_of_this_process(), threads);
    // Every buffer must be back.
    std::vector<FrameBuffer*> back;
    while (FrameBuffer* buffer = exchange.empty()) back.push_back(buffer);
    EXPECT_EQ(back.size(), kBuffers);
    for (FrameBuffer* buffer : back) exchange.put_back(buffer);
  }
}

TEST_F(AravisCamera, FirstFrameOfAStreamIsRenumbered) {
  const KnownImages images = known_images(32, 32, kMono16);
  const auto server = serve(images);
  const auto camera = open();
  FrameExchange exchange(camera->format(), kBuffers);
  for (int round = 0; round < 2; ++round) {
    camera->start(exchange);
    FrameBuffer* first = exchange.take(10'000'000);
    ASSERT_NE(first, nullptr);
    // The test may be too slow to get the first frame.
    EXPECT_TRUE(first->header.renumbered || exchange.superseded() > 0);
    EXPECT_EQ(first->header.status, 0U);
    exchange.give_back(first);
    camera->stop();
    while (FrameBuffer* waiting = exchange.take(0)) exchange.give_back(waiting);
  }
}

TEST_F(AravisCamera, SoftwareTriggerMakesOneFrame) {
  const KnownImages images = known_images(32, 32, kMono16);
  const auto server = serve(images);
  CameraOptions options = packets();
  options.trigger = Trigger::kSoftware;
  const auto camera = open(options);
  FrameExchange exchange(camera->format(), kBuffers);
  Taker taker(exchange, images);
  camera->start(exchange);
  EXPECT_FALSE(taker.take_one(100'000));
  for (int i = 0; i < 5; ++i) {
    camera->trigger();
    ASSERT_TRUE(taker.take(1));
  }
  EXPECT_FALSE(taker.take_one(100'000));
  camera->stop();
  EXPECT_EQ(camera->counts().delivered, 5);
}

TEST_F(AravisCamera, TellsWhichBitsAreUsed) {
  struct Case {
    const char* format;
    std::uint32_t code;
    int left_shift;
    const char* note;
  };
  for (const Case& use : {Case{"Mono16", kMono16, 4,
                               "pixels use the upper 12 of 16 bits: values are multiples of 16"},
                          Case{"Mono12", kMono12, 0, "pixels use the lower 12 of 16 bits"},
                          Case{"Mono16", kMono16, 0, ""}}) {
    SCOPED_TRACE(use.note);
    const KnownImages images = known_images(32, 32, use.code, 7, use.left_shift);
    FakeGigeOptions served;
    served.pixel_format = use.format;
    const auto server = serve(images, served);
    const auto camera = open();
    EXPECT_FALSE(has_note(*camera, "pixels use"));
    FrameExchange exchange(camera->format(), kBuffers);
    Taker taker(exchange, images);
    camera->start(exchange);
    ASSERT_TRUE(taker.take(22));
    camera->stop();
    EXPECT_EQ(has_note(*camera, "pixels use"), *use.note != '\0');
    EXPECT_TRUE(has_note(*camera, use.note) || *use.note == '\0');
  }
}

TEST_F(AravisCamera, TellsThatTheReceiveBufferIsCapped) {
  const KnownImages images = known_images(32, 32, kMono16);
  const auto server = serve(images);
  CameraOptions options = packets();
  options.socket_buffer_bytes = 1 << 30;
  const auto camera = open(options);
  FrameExchange exchange(camera->format(), kBuffers);
  camera->start(exchange);
  camera->stop();
  EXPECT_TRUE(has_note(*camera, "`sysctl -w net.core.rmem_max=1073741824` allows it"));
}

TEST_F(AravisCamera, SeveralCamerasOnSeveralAddresses) {
  if (addresses_ < 3)
    GTEST_SKIP() << "this machine does not allow a process to have its own network";
  const KnownImages images = known_images(32, 32, kMono16);
  std::vector<std::unique_ptr<FakeGigeCamera>> servers;
  std::vector<std::unique_ptr<Camera>> cameras;
  std::vector<std::unique_ptr<FrameExchange>> exchanges;
  const char* const serials[] = {"SH1", "SH2", "SH3"};
  const char* const addresses[] = {"127.0.0.1", "127.0.0.2", "127.0.0.3"};
  for (std::size_t i = 0; i < 3; ++i) {
    FakeGigeOptions served;
    served.address = addresses[i];
    served.serial = serials[i];
    servers.push_back(serve(images, served));
  }
  const auto listed = list_aravis_cameras();
  ASSERT_EQ(listed.size(), 3U);
  for (const CameraListing& expected :
       {CameraListing{"aravis:Aravis-Fake-SH1", "Aravis Fake, serial number SH1, 127.0.0.1", ""},
        CameraListing{"aravis:Aravis-Fake-SH2", "Aravis Fake, serial number SH2, 127.0.0.2", ""},
        CameraListing{"aravis:Aravis-Fake-SH3", "Aravis Fake, serial number SH3, 127.0.0.3", ""}}) {
    EXPECT_TRUE(std::any_of(listed.begin(), listed.end(), [&](const CameraListing& listing) {
      return listing.source == expected.source && listing.description == expected.description;
    })) << expected.source;
  }
  const std::string several = failure_text([&] { open_aravis_camera("", packets(), {}); });
  EXPECT_NE(several.find("there are 3 cameras; name one: "), std::string::npos) << several;
  EXPECT_NE(several.find("aravis:Aravis-Fake-SH2"), std::string::npos) << several;

  for (const char* id : {"127.0.0.1", "127.0.0.2", "Aravis-Fake-SH3"}) {
    cameras.push_back(open_aravis_camera(id, packets(), {}));
    exchanges.push_back(std::make_unique<FrameExchange>(cameras.back()->format(), kBuffers));
    cameras.back()->start(*exchanges.back());
  }
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NE(cameras[i]->description().find(serials[i]), std::string::npos);
    Taker taker(*exchanges[i], images);
    EXPECT_TRUE(taker.take(10));
    cameras[i]->stop();
  }
}

TEST_F(AravisCamera, TheOnlyCameraNeedsNoName) {
  const std::string none = failure_text([] { open_aravis_camera("", packets(), {}); });
  EXPECT_NE(none.find("aravis: there is no GenICam camera; `curlew cameras` lists"),
            std::string::npos)
      << none;
  const KnownImages images = known_images(16, 16, kMono16);
  const auto server = serve(images);
  EXPECT_NE(open_aravis_camera("", packets(), {}), nullptr);
}

TEST_F(AravisCamera, AbsentAddressIsSaidSoInSeconds) {
  const auto begin = std::chrono::steady_clock::now();
  const std::string text = failure_text([] { open_aravis_camera("127.0.0.77", packets(), {}); });
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(20));
  EXPECT_NE(text.find("aravis:127.0.0.77 cannot be opened: "), std::string::npos) << text;
  EXPECT_NE(text.find("subnet"), std::string::npos) << text;
}

TEST_F(AravisCamera, CameraOfAnotherProgramIsNotTaken) {
  const KnownImages images = known_images(16, 16, kMono16);
  const auto server = serve(images);
  const auto first = open();
  const std::string text = failure_text([] { open(); });
  EXPECT_NE(text.find("controlled by another program"), std::string::npos) << text;
}

}  // namespace
}  // namespace curlew
