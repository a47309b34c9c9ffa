// A dark and a reference taken beside the running pipeline become its sensor; what fails, or would
// replace a file, changes nothing.
#include "service/daemon/live_calibration.h"

#include <gtest/gtest.h>

#include <cstring>
#include <filesystem>
#include <random>
#include <thread>

#include "acquisition/simulator/simulator.h"
#include "service/sensor/sensor_file.h"
#include "tests/support/exact_sensor.h"
#include "tests/support/failure_text.h"
#include "tests/support/scratch_directory.h"

namespace curlew {
namespace {

using namespace std::chrono_literals;

constexpr int kSide = 8;
constexpr int kCalibrationWindow = 10;
constexpr double kBias = 100.0;
constexpr int kImages = 12;

/// A camera whose light can be switched off, and a pipeline that runs on it.
class LiveCalibrationTest : public ::testing::Test {
 protected:
  static SimulatorOptions plane() {
    SimulatorOptions options;
    options.rows = options.cols = kSide;
    options.window_px = kCalibrationWindow;
    options.photons = 20'000.0;
    options.bit_depth = 14;
    options.bias_adu = kBias;
    options.frames = kImages;
    return options;
  }

  void SetUp() override {
    Simulator simulator(plane());
    format_ = simulator.format();
    FrameBuffer frame(format_);
    while (simulator.next(frame) == Delivery::kFrame) {
      lit_.emplace_back(frame.data(), frame.data() + format_.bytes());
      std::vector<std::uint16_t> pixels(format_.pixels());
      for (std::uint16_t& pixel : pixels)
        pixel = static_cast<std::uint16_t>(std::lround(noise_(random_)));
      dark_.emplace_back(format_.bytes());
      std::memcpy(dark_.back().data(), pixels.data(), format_.bytes());
    }
    if (outer_are_dark_) darken_outer_lenslets();
    Sensor sensor = sensor_of(simulator, kCalibrationWindow, kBias);
    sensor.flux_adu = Image<float>(kSide, kSide, 1000.0F);
    write_sensor(old_path_, sensor);
    config_.daemon.sensor = old_path_;
    config_.recorder.folder = folder_.path();
    pipeline_.emplace([this] { return config_; }, status_);
    calibration_.emplace(*pipeline_);
    pipeline_->prepare(format_);
    exchange_.emplace(format_, config_.pipeline.slots + 4);
    camera_ = std::thread([this] { send(); });
    frames_ = std::thread([this] {
      LiveFeed feed(*exchange_, {}, control_);
      pipeline_->run(feed);
    });
  }
  void darken_outer_lenslets() {
    const auto within = [](int px) {
      return px >= kCalibrationWindow && px < (kSide - 1) * kCalibrationWindow;
    };
    for (std::size_t i = 0; i < lit_.size(); ++i)
      for (int row = 0; row < format_.rows; ++row)
        for (int col = 0; col < format_.cols; ++col) {
          const auto at = static_cast<std::size_t>(2 * (row * format_.cols + col));
          if (!within(row) || !within(col)) std::memcpy(&lit_[i][at], &dark_[i][at], 2);
        }
  }
  void TearDown() override {
    calibration_->stop();
    stop_ = true;
    camera_.join();
    exchange_->close();
    frames_.join();
    pipeline_->finish();
  }

  void send() {
    for (std::int64_t n = 0; !stop_; ++n) {
      if (FrameBuffer* frame = exchange_->empty(); frame != nullptr && !silent_) {
        const auto& images = light_ ? lit_ : dark_;
        std::memcpy(frame->data(), images[static_cast<std::size_t>(n % kImages)].data(),
                    format_.bytes());
        frame->header = {.sequence = n, .received = std::chrono::steady_clock::now()};
        frame->rows_ready = format_.rows;
        if (FrameBuffer* old = exchange_->deliver(frame)) exchange_->put_back(old);
      } else if (frame != nullptr) {
        exchange_->put_back(frame);
      }
      std::this_thread::sleep_for(2ms);
    }
  }

  /// Takes frames and returns what became of them.
  std::string take(LiveCalibration::Kind kind) {
    calibration_->begin(kind, kImages, "somebody");
    for (int i = 0; i < 3000; ++i) {
      pipeline_->adopt_pending_plan();
      const std::string text = calibration_->text();
      if (text.find("; calibrating") == std::string::npos && text.rfind("taking", 0) != 0)
        return text;
      std::this_thread::sleep_for(10ms);
    }
    return "it did not end";
  }
  /// Returns the files in the folder whose names begin like this.
  std::vector<std::string> files(const std::string& begin) const {
    std::vector<std::string> found;
    for (const auto& entry : std::filesystem::directory_iterator(folder_.path()))
      if (entry.path().filename().string().rfind(begin, 0) == 0) found.push_back(entry.path());
    return found;
  }

  bool outer_are_dark_ = false;
  ScratchDirectory folder_;
  const std::string old_path_ = folder_ / "old.fits";
  std::mt19937 random_{1};
  std::normal_distribution<double> noise_{kBias, 2.0};
  FrameFormat format_;
  std::vector<std::vector<std::byte>> lit_;
  std::vector<std::vector<std::byte>> dark_;
  Config config_;
  DaemonStatus status_;
  std::optional<DaemonPipeline> pipeline_;
  std::optional<LiveCalibration> calibration_;
  std::optional<FrameExchange> exchange_;
  FeedControl control_;
  std::atomic<bool> stop_{false};
  std::atomic<bool> light_{true};
  std::atomic<bool> silent_{false};
  std::thread camera_;
  std::thread frames_;
};

TEST_F(LiveCalibrationTest, ADarkAndAReferenceBecomeTheSensor) {
  light_ = false;
  std::this_thread::sleep_for(150ms);
  std::string text = take(LiveCalibration::Kind::kDark);
  EXPECT_NE(text.find("a dark of 100 ADU"), std::string::npos) << text;
  ASSERT_EQ(files("dark-").size(), 1U) << text;
  EXPECT_EQ(pipeline_->config().daemon.sensor, old_path_) << "a dark alone changes nothing";
  light_ = true;
  std::this_thread::sleep_for(150ms);
  text = take(LiveCalibration::Kind::kReference);
  EXPECT_NE(text.find("12 of the 1"), std::string::npos) << text;
  EXPECT_NE(text.find("64 of 8 x 8 lenslets lit"), std::string::npos) << text;
  const std::vector<std::string> sensors = files("sensor-");
  ASSERT_EQ(sensors.size(), 1U) << text;
  EXPECT_NE(text.find(sensors[0] + " is in use"), std::string::npos) << text;
  EXPECT_EQ(pipeline_->config().daemon.sensor, sensors[0]);
  const Sensor fresh = pipeline_->sensor();
  ASSERT_FALSE(fresh.dark_adu.empty());
  EXPECT_NEAR(fresh.dark_adu(3, 3), kBias, 3.0);
  EXPECT_NEAR(fresh.grid.pitch_px(), kCalibrationWindow, 0.02);
  EXPECT_EQ(fresh.optics.focal_m, read_sensor(old_path_).optics.focal_m);
  EXPECT_EQ(sensor_hash(fresh), sensor_hash(read_sensor(sensors[0])));
  EXPECT_TRUE(files(".").empty() && files("taken").empty()) << "what was taken is gone";
  // A reload has the configuration's sensor again.
  pipeline_->reload();
  EXPECT_EQ(pipeline_->config().daemon.sensor, old_path_);
}

TEST_F(LiveCalibrationTest, WhatFailsLeavesTheOldSensorAndNoFile) {
  std::string text = take(LiveCalibration::Kind::kDark);
  EXPECT_NE(text.find("no dark was taken, the old sensor stays: the stack is not dark"),
            std::string::npos)
      << text;
  light_ = false;
  std::this_thread::sleep_for(150ms);
  text = take(LiveCalibration::Kind::kReference);
  EXPECT_NE(text.find("no reference was taken, the old sensor stays"), std::string::npos) << text;
  EXPECT_EQ(pipeline_->config().daemon.sensor, old_path_);
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder_.path()), {}), 1)
      << "the old sensor alone";
}

/// The streams that are published have room for the old sensor's lenslets only.
class PublishingCalibrationTest : public LiveCalibrationTest {
 protected:
  PublishingCalibrationTest() {
    config_.publish.streams = {PublishedStream::kMask};
    config_.publish.folder = streams_.path();
    outer_are_dark_ = true;
  }
  ScratchDirectory streams_;
};

TEST_F(PublishingCalibrationTest, ASensorThatCannotBeTakenUpLeavesNoFile) {
  const std::string text = take(LiveCalibration::Kind::kReference);
  EXPECT_NE(text.find("the old sensor stays: the published streams are of 8 x 8 lenslets"),
            std::string::npos)
      << text;
  EXPECT_TRUE(files("sensor-").empty());
  EXPECT_EQ(pipeline_->config().daemon.sensor, old_path_);
}

TEST_F(LiveCalibrationTest, OneAtATimeAndNotWithoutEnd) {
  using Kind = LiveCalibration::Kind;
  EXPECT_NE(failure_text<UsageError>([&] {
              calibration_->begin(Kind::kDark, 0, "");
            }).find("from 1 to 10000"),
            std::string::npos);
  silent_ = true;
  calibration_->begin(Kind::kReference, 10'000, "somebody");
  EXPECT_NE(
      failure_text<UsageError>([&] { calibration_->begin(Kind::kDark, 5, ""); }).find("wait until"),
      std::string::npos);
  calibration_->stop();  // must not wait for the frames
  EXPECT_NE(calibration_->text().find("curlew is stopping"), std::string::npos);
  EXPECT_NE(
      failure_text<UsageError>([&] { calibration_->begin(Kind::kDark, 5, ""); }).find("stopping"),
      std::string::npos);
}

}  // namespace
}  // namespace curlew
