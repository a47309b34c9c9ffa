// The daemon runs in this process, on cameras that need no hardware, and meets unusual situations.
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <thread>

#include "acquisition/recording/recording.h"
#include "acquisition/simulator/simulator.h"
#include "service/daemon/daemon.h"
#include "service/sensor/sensor_file.h"
#include "tests/support/exact_sensor.h"
#include "tests/support/failure_text.h"
#include "tests/support/scratch_directory.h"

namespace curlew {
namespace {

using namespace std::chrono_literals;

constexpr std::int64_t kFrames = 4;
constexpr int kWindow = 8;

SimulatorOptions few_frames() {
  SimulatorOptions options;
  options.rows = options.cols = 8;
  options.window_px = kWindow;
  options.frames = kFrames;
  return options;
}

/// Makes a recording of a few frames and a sensor that fits it.
class EdgeOfDaemon : public ::testing::Test {
 protected:
  void SetUp() override {
    Simulator simulator(few_frames());
    RecordingWriter writer(recording_, simulator.format(), simulator.optics(), simulator.detector(),
                           "test");
    FrameBuffer frame(simulator.format());
    while (simulator.next(frame) == Delivery::kFrame) writer.append(frame.view(), frame.header);
    writer.commit();
    write_sensor(sensor_, sensor_of(simulator, kWindow, 0.0));
  }
  Config config() const {
    Config config;
    config.camera.source = "file:" + recording_;
    config.camera.frame_rate_hz = 20.0;
    config.daemon.sensor = sensor_;
    return config;
  }

  ScratchDirectory folder_;
  const std::string recording_ = folder_ / "frames.fits";
  const std::string sensor_ = folder_ / "sensor.fits";
};

TEST_F(EdgeOfDaemon, ARecordingPlayedSlowerThanTheTimeoutIsNotLost) {
  Config slow = config();
  slow.camera.timeout_s = 0.02;
  DaemonLimits limits;
  limits.seconds = 20.0;  // not reached
  Daemon daemon([&] { return slow; }, limits);
  const DaemonReport report = daemon.run();
  EXPECT_EQ(report.connections, 1);
  EXPECT_EQ(report.frames.delivered, kFrames);
  EXPECT_EQ(report.results.frames + report.superseded + report.unprocessed, kFrames);
}

TEST_F(EdgeOfDaemon, ARecordingThatCannotBeReadToItsEndIsAFailureAndNotBegunAgain) {
  // The recording is opened and read from, and then cut in the middle of its last frame.
  Config slow = config();
  slow.camera.frame_rate_hz = 2.0;
  DaemonLimits limits;
  limits.seconds = 20.0;  // not reached
  Daemon daemon([&] { return slow; }, limits);
  std::thread cuts([&] {
    std::this_thread::sleep_for(700ms);
    std::filesystem::resize_file(recording_, 2880);
  });
  const std::string text = failure_text([&] { daemon.run(); });
  cuts.join();
  EXPECT_NE(text.find("frames.fits"), std::string::npos) << text;
}

TEST_F(EdgeOfDaemon, StatusIsAnsweredWhateverBytesTheCameraIsCalledBy) {
  const std::string odd = folder_ / "\xff.fits";
  std::filesystem::copy_file(recording_, odd);
  Config socket = config();
  socket.camera.source = "file:" + odd;
  socket.camera.frame_rate_hz = 2.0;
  socket.daemon.control = folder_ / "control";
  Daemon daemon([&] { return socket; }, {});
  std::string answer;
  std::thread asks([&] {
    // While the daemon streams, the reason of its state holds the camera's name.
    for (int i = 0; i < 100 && answer.find("streaming") == std::string::npos; ++i) {
      std::this_thread::sleep_for(10ms);
      try {
        answer = ask_daemon(socket.daemon.control, "status");
      } catch (const Failure&) {  // the daemon has ended
        break;
      }
    }
  });
  daemon.run();
  asks.join();
  EXPECT_NE(answer.find("streaming"), std::string::npos) << answer;
}

TEST_F(EdgeOfDaemon, SaysAllThatItKnowsOfItselfAndGivesAFrame) {
  Config socket = config();
  socket.camera.frame_rate_hz = 2.0;
  socket.daemon.control = folder_ / "control";
  Daemon daemon([&] { return socket; }, {});
  std::string status;
  std::string metrics;
  std::string snapshot;
  std::thread asks([&] {
    // Until a frame comes there is none to take.
    for (int i = 0; i < 100 && snapshot.rfind("SIMPLE", 0) != 0; ++i) {
      std::this_thread::sleep_for(10ms);
      try {
        snapshot = ask_daemon(socket.daemon.control, "snapshot");
        metrics = ask_daemon(socket.daemon.control, "metrics");
        status = ask_daemon(socket.daemon.control, "status");
      } catch (const Failure&) {  // the daemon has ended
        break;
      }
    }
  });
  daemon.run();
  asks.join();
  EXPECT_EQ(snapshot.size() % 2880, 0U);
  EXPECT_NE(snapshot.find("CURLEW RESULTS"), std::string::npos);
  EXPECT_NE(metrics.find("\ncurlew_frames_total{outcome=\"result\"} "), std::string::npos);
  EXPECT_EQ(metrics.back(), '\n');
  for (const std::string field :
       {"program",           "config_hash", "camera",  "uptime_s",   "newest_age_s", "n_vortices",
        "frames_per_s",      "p50_us",      "p99_us",  "max_us",     "late",         "unprocessed",
        "no_buffer",         "timed_out",   "aborted", "wrong_size", "other",        "files",
        "recording_stopped", "free_mb"})
    EXPECT_NE(status.find('"' + field + "\":"), std::string::npos) << field << ": " << status;
  EXPECT_NE(status.find(config_hash(socket)), std::string::npos) << status;
}

TEST_F(EdgeOfDaemon, AReloadBeforeTheFirstConnectionRefusesASensorForOtherFrames) {
  SimulatorOptions larger = few_frames();
  larger.window_px = kWindow + 2;
  Simulator other(larger);
  const std::string other_sensor = folder_ / "other.fits";
  write_sensor(other_sensor, sensor_of(other, kWindow + 2, 0.0));
  const Simulator simulator(few_frames());
  Config changing = config();
  DaemonStatus status;
  DaemonPipeline pipeline([&] { return changing; }, status);
  changing.daemon.sensor = other_sensor;
  pipeline.reload();
  EXPECT_EQ(pipeline.config().daemon.sensor, sensor_) << "the old plan must stay";
  EXPECT_NO_THROW(pipeline.prepare(simulator.format()));
  // One for the same frames is taken.
  std::filesystem::copy_file(sensor_, folder_ / "copy.fits");
  changing.daemon.sensor = folder_ / "copy.fits";
  pipeline.reload();
  EXPECT_EQ(pipeline.config().daemon.sensor, changing.daemon.sensor);
}

TEST_F(EdgeOfDaemon, ATriggerThatWouldWaitForEverIsRefused) {
  Config config = this->config();
  config.recorder.mode = RecordMode::kTrigger;
  config.recorder.folder = folder_.path();
  config.recorder.trigger_on_vortex = config.recorder.trigger_tracked_only = true;
  DaemonStatus status;
  const auto text = [&] {
    return failure_text<UsageError>([&] { DaemonPipeline([&] { return config; }, status); });
  };
  EXPECT_NE(text().find("trigger_tracked_only needs tracks"), std::string::npos);
  config.recorder.trigger_tracked_only = false;
  config.recorder.trigger_min_probability = 0.9;
  config.detect.method = DetectMethod::kCirculation;
  EXPECT_NE(text().find("trigger_min_probability needs probabilities"), std::string::npos);
  config.track.enabled = true;
  EXPECT_NO_THROW(DaemonPipeline([&] { return config; }, status));
}

TEST(ControlSocketEdge, AFolderThatDoesNotExistIsNamedWithTheRemedy) {
  const ScratchDirectory folder;
  try {
    const ControlSocket control(folder / "none/control");
    FAIL() << "it must be refused";
  } catch (const UsageError& error) {
    const std::string text = error.what();
    EXPECT_NE(text.find((folder / "none") + " does not exist; make it"), std::string::npos) << text;
  }
}

// The system would say at once, again and again, that somebody waits to be let in.
TEST(ControlSocketEdge, WithoutAFreeDescriptorItWaitsAndAnswersLater) {
  const ScratchDirectory folder;
  const ControlSocket control(folder / "control");
  std::string answer;
  std::thread asks([&] {
    try {
      answer = ask_daemon(folder / "control", "status");
    } catch (const Failure& failure) {
      answer = failure.what();
    }
  });
  std::this_thread::sleep_for(200ms);  // It is in the queue.
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_NOFILE, &before), 0);
  const int next = dup(STDERR_FILENO);
  close(next);
  const rlimit none{static_cast<rlim_t>(next), before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &none), 0);
  int served = 0;
  const auto count = [&](const std::string&) {
    ++served;
    return std::string("well");
  };
  const auto begin = std::chrono::steady_clock::now();
  for (int i = 0; i < 4; ++i) control.serve(100, count);
  const auto waited = std::chrono::steady_clock::now() - begin;
  setrlimit(RLIMIT_NOFILE, &before);
  EXPECT_EQ(served, 0);
  EXPECT_GE(waited, 400ms);
  control.serve(1000, count);
  asks.join();
  EXPECT_EQ(served, 1);
  EXPECT_EQ(answer, "well");
}

TEST(ControlSocketEdge, AFileThatIsNoSocketStays) {
  const ScratchDirectory folder;
  const std::string path = folder / "notes.txt";
  write_bytes(path, "precious");
  EXPECT_THROW(ControlSocket socket(path), Failure);
  EXPECT_EQ(read_bytes(path), "precious");
}

TEST(ControlSocketEdge, SomebodyWhoDribblesIsNotListenedToForEver) {
  const ScratchDirectory folder;
  ControlSocket control(folder / "control");
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::strcpy(address.sun_path, (folder / "control").c_str());
  const int peer = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  ASSERT_EQ(connect(peer, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  std::atomic<bool> served{false};
  int sent = 0;
  std::thread dribbles([&] {
    while (!served && sent < 300) {  // for 30 s at most
      if (send(peer, "x", 1, MSG_NOSIGNAL) == 1) ++sent;
      std::this_thread::sleep_for(100ms);
    }
  });
  control.serve(1000, [](const std::string&) { return std::string("error: what?"); });
  served = true;
  dribbles.join();
  close(peer);
  EXPECT_GT(sent, 0);
  EXPECT_LT(sent, 300);
}

}  // namespace
}  // namespace curlew
