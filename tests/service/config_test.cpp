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
  config.split.weighted = true;
  config.detect.false_alarms_per_frame = 0.25;
  config.pipeline.threads = Threading::kPerStage;
  config.pipeline.slots = 5;
  config.pipeline.cpus = {0, 1};
  const ScratchDirectory scratch;
  write_bytes(scratch / "c.toml", config_text(config));
  const Config back = read_config(scratch / "c.toml");
  EXPECT_EQ(config_text(back), config_text(config));
  EXPECT_EQ(config_hash(back), config_hash(config));
  EXPECT_NE(config_hash(back), config_hash(Config{}));
  EXPECT_EQ(back.pipeline.cpus, config.pipeline.cpus);
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
  EXPECT_NE(error.find("false_alarms_per_frame"), std::string::npos) << "names the known ones";
  EXPECT_NE(usage_error("[camera]\nid = 1\n").find(":1: unknown section 'camera'"),
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
  EXPECT_NE(usage_error("[pipeline]\nthreads = \"many\"\n").find("inline or per_stage"),
            std::string::npos);
  EXPECT_NE(usage_error("[split]\nweighted = 1\n").find("true or false"), std::string::npos);
  EXPECT_NE(usage_error("[split\n").find("c.toml:1: "), std::string::npos);
  EXPECT_THROW(read_config("/nonexistent/c.toml"), UsageError);
}

}  // namespace
}  // namespace curlew
