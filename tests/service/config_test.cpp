#include "service/config.h"

#include <gtest/gtest.h>

#include "core/error.h"
#include "tests/support/scratch_directory.h"

namespace curlew {
namespace {

std::string usage_error(const std::string& toml) {
  const ScratchDirectory scratch;
  write_bytes(scratch / "c.toml", toml);
  try {
    read_config(scratch / "c.toml");
  } catch (const UsageError& error) {
    return error.what();
  }
  return {};
}

TEST(Config, WhatIsWrittenReadsBack) {
  Config config;
  config.centroid.threshold_noise = 4.5;
  config.centroid.method = CentroidMethod::kMaximumLikelihood;
  config.split.weighted = true;
  config.detect.false_alarms_per_frame = 0.25;
  config.pipeline.threads = Threading::kTeam;
  config.pipeline.slots = 5;
  config.pipeline.cpus = {0, 1};
  config.daemon.sensor = "a \"quoted\" \\ name.fits";
  config.camera.trigger = Trigger::kSoftware;
  config.camera.packet_delay_ns = 123456;
  // The order must be kept.
  config.camera.features = {{"LineSelector", "Line1"}, {"LineMode", "Input"}};
  config.camera.usb.sync = "a55a";
  config.realtime.camera_cpus = {1};
  config.recorder.mode = RecordMode::kTrigger;
  const ScratchDirectory scratch;
  write_bytes(scratch / "c.toml", config_text(config));
  const Config back = read_config(scratch / "c.toml");
  EXPECT_EQ(config_text(back), config_text(config));
  EXPECT_EQ(config_hash(back), config_hash(config));
  EXPECT_NE(config_hash(back), config_hash(Config{}));
  EXPECT_EQ(back.pipeline.cpus, config.pipeline.cpus);
  EXPECT_EQ(back.daemon.sensor, config.daemon.sensor);
  EXPECT_EQ(back.camera.features, config.camera.features);
  EXPECT_EQ(back.camera.trigger, Trigger::kSoftware);
  EXPECT_EQ(back.centroid.method, CentroidMethod::kMaximumLikelihood);
  EXPECT_EQ(back.recorder.mode, RecordMode::kTrigger);
}

TEST(Config, FeaturesTakeTextsNumbersAndTruthValues) {
  const ScratchDirectory scratch;
  write_bytes(scratch / "c.toml",
              "[camera.features]\nGamma = 0.5\nLines = 3\nReverseX = true\nMode = \"On\"\n");
  const std::vector<std::pair<std::string, std::string>> expected{
      {"Gamma", "0.5"}, {"Lines", "3"}, {"ReverseX", "true"}, {"Mode", "On"}};
  EXPECT_EQ(read_config(scratch / "c.toml").camera.features, expected);
  EXPECT_NE(usage_error("[camera]\nfeatures = 3\n").find("must be a table"), std::string::npos);
  EXPECT_NE(usage_error("[camera.features]\nGamma = [1]\n").find("camera.features.Gamma"),
            std::string::npos);
}

TEST(Config, WordsThatAreNotKnownAreListed) {
  EXPECT_NE(usage_error("[camera]\ntrigger = \"often\"\n")
                .find(R"(one of "as_is", "free", "line", "software")"),
            std::string::npos);
  EXPECT_NE(usage_error("[recorder]\nmode = 1\n").find(R"("continuous")"), std::string::npos);
  EXPECT_NE(usage_error("[daemon]\nsensor = 1\n").find("a text in quotes"), std::string::npos);
}

TEST(Config, NamesTheSectionsThatChanged) {
  Config a;
  Config b;
  EXPECT_TRUE(changed_sections(a, b).empty());
  b.camera.exposure_us = 100.0;
  b.detect.lobe_fraction = 0.5;
  EXPECT_EQ(changed_sections(a, b), (std::set<std::string>{"camera", "detect"}));
}

TEST(Config, AnEmptyFileIsTheDefaults) {
  const ScratchDirectory scratch;
  write_bytes(scratch / "c.toml", "");
  EXPECT_EQ(config_text(read_config(scratch / "c.toml")), config_text(Config{}));
}

TEST(Config, UnknownKeysNameTheirLine) {
  const std::string error = usage_error("[detect]\nfalse_alarms_per_frame = 1\nfalse_alarm = 2\n");
  EXPECT_NE(error.find("c.toml:3: unknown key 'false_alarm' in [detect]"), std::string::npos)
      << error;
  EXPECT_NE(error.find("false_alarms_per_frame"), std::string::npos)
      << "it must name the known keys";
  EXPECT_NE(usage_error("[kamera]\nid = 1\n").find(":1: unknown section 'kamera'"),
            std::string::npos);
  EXPECT_NE(usage_error("threads = 1\n").find(":1: unknown section 'threads'"), std::string::npos);
}

TEST(Config, ValuesOfTheWrongKindAreRefused) {
  EXPECT_NE(usage_error("[detect]\nfalse_alarms_per_frame = \"few\"\n").find(":2: "),
            std::string::npos);
  EXPECT_NE(usage_error("[detect]\nfalse_alarms_per_frame = -1\n").find("must be a number"),
            std::string::npos);
  EXPECT_NE(usage_error("[detect]\nfalse_alarms_per_frame = nan\n").find("must be a number"),
            std::string::npos);
  EXPECT_NE(usage_error("[pipeline]\nslots = 2.5\n").find("whole number"), std::string::npos);
  EXPECT_NE(usage_error("[pipeline]\nslots = 1\n").find("from 2"), std::string::npos);
  EXPECT_NE(usage_error("[pipeline]\nthreads = \"many\"\n").find(R"("inline", "team")"),
            std::string::npos);
  EXPECT_NE(usage_error("[split]\nweighted = 1\n").find("true or false"), std::string::npos);
  EXPECT_NE(usage_error("[split\n").find("c.toml:1: "), std::string::npos);
  EXPECT_THROW(read_config("/nonexistent/c.toml"), UsageError);
}

// The parser goes down the stack with every level; 30,000 of them were a crash.
TEST(Config, NestingBeyondReasonIsRefused) {
  std::string dotted = "a";
  for (int i = 0; i < 30000; ++i) dotted += ".a";
  EXPECT_NE(usage_error(dotted + " = 1\n").find("c.toml:1: the line has more than 40 dots"),
            std::string::npos);
  EXPECT_NE(usage_error("\n[" + dotted + "]\n").find("c.toml:2:"), std::string::npos);
  // As deep as the lines allow: every level of a list holds a dotted key of its own.
  std::string deep = "x = ";
  for (int i = 0; i < 200; ++i) deep += "[\n{" + dotted.substr(0, 79) + " = ";
  EXPECT_NE(usage_error(deep), "");
  EXPECT_NE(usage_error("x = " + std::string(100000, '[')), "");
}

TEST(Config, SizesBeyondReasonAreRefused) {
  EXPECT_NE(usage_error(std::string(1'000'001, '\n')).find("larger than 1 MB"), std::string::npos);
  std::string features = "[camera.features]\n";
  for (int i = 0; i < 1001; ++i) features.append("f").append(std::to_string(i)).append(" = 1\n");
  EXPECT_NE(usage_error(features).find("at most 1000"), std::string::npos);
}

}  // namespace
}  // namespace curlew
