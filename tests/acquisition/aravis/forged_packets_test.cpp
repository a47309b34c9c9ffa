// Packets that others send to the port of a network camera's frames, and packets that the camera
// itself never should have sent, must do no harm and make no frame.
#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/ip.h>
#include <netinet/udp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <string>
#include <thread>

#include "acquisition/aravis/socket_filter.h"
#include "tests/acquisition/aravis/served_camera.h"

namespace curlew {
namespace {

using Packet = std::string;

constexpr std::uint32_t kLeader = 1;
constexpr std::uint32_t kTrailer = 2;
constexpr std::uint32_t kPayload = 3;

Packet bytes_of(std::initializer_list<std::uint32_t> values) {
  Packet bytes;
  for (const std::uint32_t value : values) bytes += static_cast<char>(value & 0xFFU);
  return bytes;
}

/// Returns a packet of GigE Vision's stream protocol. data: what follows the header.
Packet packet(std::uint32_t content, std::uint32_t frame, std::uint32_t number,
              const Packet& data) {
  return bytes_of({0, 0, frame >> 8, frame, content, number >> 16, number >> 8, number}) + data;
}

/// Returns the packets of a whole frame of 64 × 64 pixels of Mono16, all 0xEEEE.
std::vector<Packet> forged_frame(std::uint32_t frame) {
  const Packet leader = bytes_of({0, 0,  0, 1, 0, 0,  0, 0, 0, 0, 0, 1, 1, 16, 0, 7, 0, 0,
                                  0, 64, 0, 0, 0, 64, 0, 0, 0, 0, 0, 0, 0, 0,  0, 0, 0, 0});
  constexpr std::size_t kBlock = 8192 - 36;
  return {packet(kLeader, frame, 0, leader), packet(kPayload, frame, 1, Packet(kBlock, '\xEE')),
          packet(kPayload, frame, 2, Packet(64 * 64 * 2 - kBlock, '\xEE')),
          packet(kTrailer, frame, 3, bytes_of({0, 0, 0, 1, 0, 0, 0, 64}))};
}

/// Sends packets from an address, and any port or the one that is given, to a port of 127.0.0.1.
class Sender {
 public:
  Sender(const char* address, int to_port, int from_port = 0)
      : fd_(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in from{};
    from.sin_family = AF_INET;
    from.sin_port = htons(static_cast<std::uint16_t>(from_port));
    inet_pton(AF_INET, address, &from.sin_addr);
    EXPECT_EQ(bind(fd_, reinterpret_cast<sockaddr*>(&from), sizeof from), 0);
    to_.sin_family = AF_INET;
    to_.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    to_.sin_port = htons(static_cast<std::uint16_t>(to_port));
  }
  ~Sender() { close(fd_); }
  Sender(const Sender&) = delete;
  Sender& operator=(const Sender&) = delete;

  void send(const Packet& bytes) const {
    sendto(fd_, bytes.data(), bytes.size(), 0, reinterpret_cast<const sockaddr*>(&to_), sizeof to_);
  }

 private:
  int fd_;
  sockaddr_in to_{};
};

/// Sends packets that bear the camera's own address and port. It needs the right to do so.
class Impostor {
 public:
  Impostor(int from_port, int to_port)
      : from_port_(from_port),
        to_port_(to_port),
        fd_(socket(AF_INET, SOCK_RAW | SOCK_CLOEXEC, IPPROTO_RAW)) {}
  ~Impostor() {
    if (fd_ >= 0) close(fd_);
  }
  Impostor(const Impostor&) = delete;
  Impostor& operator=(const Impostor&) = delete;

  bool may() const { return fd_ >= 0; }
  void send(const Packet& bytes) const {
    iphdr ip{};
    udphdr udp{};
    ip.version = 4;
    ip.ihl = 5;
    ip.ttl = 64;
    ip.protocol = IPPROTO_UDP;
    ip.saddr = ip.daddr = htonl(INADDR_LOOPBACK);
    udp.source = htons(static_cast<std::uint16_t>(from_port_));
    udp.dest = htons(static_cast<std::uint16_t>(to_port_));
    udp.len = htons(static_cast<std::uint16_t>(sizeof udp + bytes.size()));
    Packet whole(sizeof ip + sizeof udp, '\0');
    std::memcpy(whole.data(), &ip, sizeof ip);
    std::memcpy(whole.data() + sizeof ip, &udp, sizeof udp);
    whole += bytes;
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    sendto(fd_, whole.data(), whole.size(), 0, reinterpret_cast<sockaddr*>(&to), sizeof to);
  }

 private:
  int from_port_;
  int to_port_;
  int fd_;
};

/// Returns packets that are too short for what they say they are, and some of no kind.
std::vector<Packet> malformed_packets() {
  std::vector<Packet> packets{"", bytes_of({0}), bytes_of({0, 0, 0, 1, 3, 0, 0})};
  for (const std::uint32_t content :
       {0U, 1U, 2U, 3U, 4U, 5U, 6U, 7U, 8U, 0x7fU, 0x81U, 0x82U, 0x83U, 0xffU})
    for (std::size_t length = 0; length < (content >= 0x80 ? 13U : 1U); ++length)
      packets.push_back(packet(content, 7, 1, Packet(length, '\xEE')));
  for (std::size_t length = 0; length < 36; ++length)
    packets.push_back(packet(kLeader, 7, 0, Packet(length, '\1')));
  for (std::size_t length = 0; length < 4; ++length)
    packets.push_back(packet(kTrailer, 7, 3, Packet(length, '\1')));
  return packets;
}

/// Returns a camera's answer to the request of this number: the register that was read holds
/// 0xDEADBEEF.
Packet forged_answer(std::uint32_t request) {
  constexpr std::uint32_t kReadRegisterAnswer = 0x81;
  return bytes_of({0, 0, 0, kReadRegisterAnswer, 0, 4, request >> 8, request}) + "\xDE\xAD\xBE\xEF";
}

/// Sends such answers for all requests that there can be, over and over, for as long as it lives.
class Forger {
 public:
  Forger(const char* address, int from_port, int to_port)
      : sender_(address, to_port, from_port), thread_([this] {
          for (std::uint32_t request = 0; !ended_; ++request, ++sent_)
            sender_.send(forged_answer(request & 0xFFFFU));
        }) {}
  ~Forger() {
    ended_ = true;
    thread_.join();
  }
  Forger(const Forger&) = delete;
  Forger& operator=(const Forger&) = delete;

  std::int64_t sent() const { return sent_; }

 private:
  const Sender sender_;
  std::atomic<bool> ended_{false};
  std::atomic<std::int64_t> sent_{0};
  std::thread thread_;
};

class ForgedAnswers : public ServedCamera {
 protected:
  /// Expects that the camera starts and is heard, whatever answers come from this address and port,
  /// and that none of those reached it. By one of the registers that a start reads the frames'
  /// socket is guarded.
  void expect_only_the_cameras_answers(const char* address, int from_port) {
    const KnownImages images = known_images(64, 64, kMono16);
    FakeGigeOptions served;
    served.frame_rate_hz = 200;
    const auto server = serve(images, served);
    const std::vector<UdpSocket> before = udp_sockets();
    const auto camera = open();
    std::vector<UdpSocket> fresh = udp_sockets();
    std::erase_if(fresh, [&](const UdpSocket& socket) {
      return std::find(before.begin(), before.end(), socket) != before.end();
    });
    ASSERT_EQ(fresh.size(), 1U);

    const Forger forger(address, from_port, fresh.front().port);
    for (int start = 0; start < 3; ++start) {
      FrameExchange exchange(camera->format(), 8);
      Taker taker(exchange, images);
      camera->start(exchange);
      EXPECT_TRUE(taker.take(3)) << camera->failure();
      camera->stop();
    }
    EXPECT_EQ(camera->failure(), "");
    const std::int64_t sent = forger.sent();
    EXPECT_GT(sent, 1000);
    EXPECT_GE(camera->counts().refused_packets, sent);
  }
};

TEST_F(ForgedAnswers, OfOthersAreNotTakenForTheCameras) {
  if (addresses_ < 2) GTEST_SKIP() << "there is one address";
  expect_only_the_cameras_answers("127.0.0.2", 3956);
}

TEST_F(ForgedAnswers, OfAnotherPortAreNotTakenForTheCameras) {
  constexpr int kAnyPort = 0;
  expect_only_the_cameras_answers("127.0.0.1", kAnyPort);
}

class ForgedPackets : public ServedCamera {
 protected:
  void SetUp() override {
    ServedCamera::SetUp();
    images_ = known_images(64, 64, kMono16);
    FakeGigeOptions served;
    served.frame_rate_hz = 200;
    server_ = serve(images_, served);
    camera_ = open();
    exchange_ = std::make_unique<FrameExchange>(camera_->format(), 8);
    taker_ = std::make_unique<Taker>(*exchange_, images_);
    camera_->start(*exchange_);
    ASSERT_TRUE(taker_->take(3));
  }
  void TearDown() override {
    if (camera_) camera_->stop();
  }
  /// Expects that every frame since the start came, showed what the camera sent, and was numbered
  /// as the camera did.
  void expect_only_the_cameras_frames() {
    ASSERT_TRUE(taker_->take(3)) << camera_->failure();
    camera_->stop();
    while (taker_->take_one(0)) {
    }
    const FrameCounts counts = camera_->counts();
    EXPECT_EQ(counts.delivered, taker_->last - FakeGigeCamera::kFirstNumber + 1 - counts.lost);
    EXPECT_EQ(counts.delivered, taker_->taken + exchange_->superseded());
    EXPECT_EQ(counts.dropped(), counts.aborted + counts.lost);
    EXPECT_LE(counts.aborted, 1);
    EXPECT_EQ(camera_->failure(), "");
  }

  KnownImages images_;
  std::unique_ptr<FakeGigeCamera> server_;
  std::unique_ptr<Camera> camera_;
  std::unique_ptr<FrameExchange> exchange_;
  std::unique_ptr<Taker> taker_;
};

TEST_F(ForgedPackets, OthersMakeNoFrameAndDoNoHarm) {
  const char* asked = std::getenv("CURLEW_FORGED_PACKETS");
  const std::int64_t random_packets = asked == nullptr ? 20'000 : std::stoll(asked);
  std::vector<const char*> addresses{"127.0.0.1"};  // from another port
  if (addresses_ >= 2) addresses.push_back("127.0.0.2");
  std::mt19937 random(11);
  std::int64_t sent = 0;
  for (const char* address : addresses) {
    const Sender stranger(address, server_->stream_port());
    for (int round = 0; round < 20; ++round) {
      for (const Packet& bytes : malformed_packets()) stranger.send(bytes), ++sent;
      for (int i = 0; i < 5; ++i) {
        const auto next = static_cast<std::uint32_t>(taker_->last + 1 + i);
        for (const Packet& bytes : forged_frame(next)) stranger.send(bytes), ++sent;
      }
      ASSERT_TRUE(taker_->take(1)) << camera_->failure();
    }
    for (std::int64_t i = 0; i < random_packets; ++i) {
      Packet bytes(random() % 100, '\0');
      for (char& byte : bytes) byte = static_cast<char>(random());
      stranger.send(bytes), ++sent;
      if (i % 1000 != 0) continue;
      ASSERT_TRUE(taker_->take(1)) << camera_->failure();
    }
  }
  EXPECT_GE(camera_->counts().refused_packets, sent);
  expect_only_the_cameras_frames();
}

TEST_F(ForgedPackets, TheCamerasOwnThatAreTooShortDoNoHarm) {
  const Impostor impostor(server_->sending_port(), server_->stream_port());
  if (!impostor.may()) GTEST_SKIP() << "this user may not send packets as another";
  std::int64_t sent = 0;
  for (int round = 0; round < 50; ++round) {
    for (const Packet& bytes : malformed_packets()) impostor.send(bytes), ++sent;
    ASSERT_TRUE(taker_->take(1)) << camera_->failure();
  }
  // It must have come as far as the filter: a whole packet of the camera's address goes through.
  const std::int64_t refused = camera_->counts().refused_packets;
  EXPECT_EQ(refused, sent);
  impostor.send(packet(kPayload, 7, 1, Packet(16, '\xEE')));
  EXPECT_EQ(camera_->counts().refused_packets, refused);
}

}  // namespace
}  // namespace curlew
