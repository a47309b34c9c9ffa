// These tests check what a GenICam camera is told, what it really does, and how wrong settings are
// refused.
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <string>

#include "core/error.h"
#include "tests/acquisition/aravis/served_camera.h"

namespace curlew {
namespace {

class AravisSettings : public ServedCamera {
 protected:
  void SetUp() override {
    ServedCamera::SetUp();
    images_ = known_images(64, 96, kMono16);
    server_ = serve(images_);
  }
  KnownImages images_;
  std::unique_ptr<FakeGigeCamera> server_;
};

TEST_F(AravisSettings, WrongOnesNameTheKeyTheCameraAndTheRange) {
  const std::string name = "Aravis Fake, serial number CURLEW, 127.0.0.1";
  struct Case {
    std::function<void(CameraOptions&)> set;
    std::string sentence;
  };
  const Case cases[] = {
      {[](auto& o) { o.width_px = 97; }, "camera.width_px: " + name + " takes 1 to 96, not 97"},
      {[](auto& o) { o.height_px = 65; }, "camera.height_px: " + name + " takes 1 to 64, not 65"},
      {[](auto& o) { o.x_px = 97; }, "camera.x_px: " + name + " takes 0 to 96, not 97"},
      {[](auto& o) { o.exposure_us = 5; },
       "camera.exposure_us: " + name + " takes 10 to 10000000, not 5"},
      {[](auto& o) { o.gain_db = 11; }, "camera.gain_db: " + name + " takes 0 to 10, not 11"},
      {[](auto& o) { o.frame_rate_hz = 1e6; }, "camera.frame_rate_hz: " + name + " takes "},
      {[](auto& o) { o.packet_size_bytes = 100; },
       "camera.packet_size_bytes: " + name + " takes 220 to 16404, not 100"},
      {[](auto& o) { o.pixel_format.append("Mono99"); },
       "camera.pixel_format: " + name + " takes "},
      {[](auto& o) {
         o.trigger = Trigger::kLine;
         o.trigger_line.back() = '9';
       },
       "camera.trigger_line: " + name + " has no trigger source Line9, only Line0, Software"},
      {[](auto& o) { o.features.emplace_back("Warp", "9"); },
       "camera.features.Warp: " + name + " has no feature of this name"},
      {[](auto& o) { o.features.emplace_back("GainRaw", "12"); },
       "camera.features.GainRaw: " + name + " takes 0 to 10, not 12"},
      {[](auto& o) { o.features.emplace_back("GainRaw", "much"); },
       "camera.features.GainRaw: " + name + " takes a whole number, not \"much\""},
      {[](auto& o) { o.features.emplace_back("ExposureTimeAbs", "long"); },
       "camera.features.ExposureTimeAbs: " + name + " takes a number, not \"long\""},
      {[](auto& o) { o.features.emplace_back("GainAuto", "Maybe"); },
       "camera.features.GainAuto: " + name + " takes Off, Once, Continuous, not \"Maybe\""},
      {[](auto& o) { o.features.emplace_back("TestBoolean", "perhaps"); },
       "camera.features.TestBoolean: " + name + " takes true or false, not \"perhaps\""},
      {[](auto& o) { o.features.emplace_back("DeviceVersion", "2"); },
       "camera.features.DeviceVersion: " + name + " lets this feature be read only"},
  };
  for (const Case& wrong : cases) {
    SCOPED_TRACE(wrong.sentence);
    CameraOptions options = packets();
    wrong.set(options);
    std::string text;
    try {
      open(options);
    } catch (const UsageError& error) {
      text = error.what();
    } catch (const Failure& error) {
      text = std::string("Failure: ").append(error.what());
    }
    EXPECT_EQ(text.substr(0, wrong.sentence.size()), wrong.sentence);
  }
}

TEST_F(AravisSettings, FormatWeDoNotReadNamesThoseWeDo) {
  CameraOptions options = packets();
  options.pixel_format = "RGB8";
  std::string text;
  try {
    open(options);
  } catch (const Failure& failure) {
    text = failure.what();
  }
  EXPECT_NE(text.find("sends RGB8, which Curlew does not read; set one of Mono8, Mono16, Mono10"),
            std::string::npos)
      << text;
}

TEST_F(AravisSettings, EveryKindOfFeatureCanBeSet) {
  CameraOptions options = packets();
  options.features = {{"GainRaw", "7"},          {"ExposureTimeAbs", "2500"},
                      {"GainAuto", "Once"},      {"TestBoolean", "true"},
                      {"TestStringReg", "lens"}, {"TriggerSoftware", "1"}};
  const auto camera = open(options);
  for (const auto& note : camera->notes()) EXPECT_EQ(note.find("asked"), std::string::npos) << note;
}

TEST_F(AravisSettings, WhatTheCameraDoesOtherwiseIsSaid) {
  CameraOptions options = packets();
  options.exposure_us = 5000.4;  // The camera keeps whole microseconds.
  options.gain_db = 3;           // The camera has a raw gain.
  options.packet_delay_ns = 0;
  options.trigger = Trigger::kFree;
  const auto notes = open(options)->notes();
  const auto said = [&](const std::string& text) {
    return std::find(notes.begin(), notes.end(), text) != notes.end();
  };
  EXPECT_TRUE(said("exposure_us: asked 5000.4, camera does 5000"));
  EXPECT_TRUE(said("gain_db: the camera takes 3 as its own gain steps, not dB"));
  EXPECT_EQ(notes.size(), 2U) << testing::PrintToString(notes);
}

TEST_F(AravisSettings, NegotiatedPacketSizeIsSaid) {
  const auto notes = open(CameraOptions{})->notes();
  ASSERT_EQ(notes.size(), 1U) << testing::PrintToString(notes);
  EXPECT_EQ(notes.front().rfind("packet_size_bytes: ", 0), 0U) << notes.front();
}

}  // namespace
}  // namespace curlew
