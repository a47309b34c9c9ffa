// The benchmarks of single stages, as commands: they run, and say as JSON what they promise.
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "tests/support/program.h"

namespace curlew {
namespace {

using nlohmann::json;

/// What the command says as JSON; a debug build must refuse, and then there is none.
json run_bench(const std::string& arguments) {
  const ScratchDirectory scratch;
  const ProgramRun run = run_curlew(scratch, "bench " + arguments + " --quick --json");
#ifdef NDEBUG
  EXPECT_EQ(run.exit_code, 0) << run.err;
  json said = json::parse(run.out, nullptr, false);
  EXPECT_TRUE(said.is_object()) << run.out;
  for (const char* key : {"program", "build", "compiler", "cpu", "cpus", "rounds", "cases"})
    EXPECT_TRUE(said.contains(key)) << key;
  return said;
#else
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_NE(run.err.find("debug build"), std::string::npos);
  return {};
#endif
}

void expect_times(const json& entry, const std::string& name) {
  ASSERT_TRUE(entry.contains(name)) << name;
  for (const char* key : {"median_us", "p10_us", "p90_us"})
    EXPECT_GT(entry[name].value(key, -1.0), 0.0) << name << ' ' << key;
}

void expect_number(const json& entry, const std::string& name) {
  ASSERT_TRUE(entry.contains(name)) << name;
  EXPECT_TRUE(entry[name].is_number()) << name;
}

TEST(BenchCommands, Centroid) {
  const json said = run_bench("centroid --rows 5 --cols 4 --window 6");
  if (said.is_null()) return;
  ASSERT_EQ(said["cases"].size(), 2U);  // u16 and u8
  for (const json& entry : said["cases"]) {
    EXPECT_EQ(entry["rows"], 5);
    EXPECT_EQ(entry["cols"], 4);
    EXPECT_EQ(entry["window_px"], 6);
    for (const char* loop : {"plain_windows", "plain_rows", "read"})
      EXPECT_TRUE(entry["build"][loop].is_string()) << loop;
    for (const char* memory : {"warm", "cold"}) {
      for (const char* name :
           {"curlew", "following", "kernel", "kernel_by_windows", "kernel_tilted",
            "kernel_without_maps", "plain_windows", "plain_rows", "read"})
        expect_times(entry[memory], name);
      for (const char* name :
           {"curlew_over_plain_windows", "curlew_over_plain_rows", "curlew_over_read",
            "curlew_over_kernel", "kernel_over_by_windows", "kernel_over_plain_windows",
            "kernel_over_plain_rows", "kernel_over_read"})
        expect_number(entry[memory], name);
    }
  }
  EXPECT_EQ(said["cases"][0]["pixels"], "u16");
  EXPECT_EQ(said["cases"][1]["pixels"], "u8");
}

TEST(BenchCommands, CentroidMethods) {
  const json said = run_bench("centroid --methods --rows 5 --cols 4 --window 6");
  if (said.is_null()) return;
  for (const char* method : {"thresholded", "plain", "weighted", "correlation", "brightest_pixels",
                             "maximum_likelihood"})
    expect_times(said["cases"][0]["methods"], method);
}

TEST(BenchCommands, Split) {
  const json said = run_bench("split --rows 10 --cols 12");
  if (said.is_null()) return;
  const json& entry = said["cases"][0];
  EXPECT_EQ(entry["rows"], 10);
  EXPECT_EQ(entry["cols"], 12);
  expect_number(entry, "lit");
  std::string names;
  for (const json& split : entry["splits"]) {
    names += split["name"].get<std::string>() + ' ';
    for (const char* name : {"warm", "cold", "plain_float", "plain_double"})
      expect_times(split, name);
    for (const char* name : {"curlew_over_plain_float", "curlew_over_plain_double", "iterations",
                             "worst_error", "plain_float_error"})
      expect_number(split, name);
    EXPECT_EQ(split["converged"], true);
  }
  EXPECT_EQ(names,
            "none_faded one_faded one_percent_faded five_percent_faded crosses_faded weighted ");
  expect_times(entry["splits"][0], "plain_kept");
}

TEST(BenchCommands, Circulation) {
  const json said = run_bench("circulation --rows 10 --cols 12 --vortices 0,2");
  if (said.is_null()) return;
  ASSERT_EQ(said["cases"].size(), 2U);
  for (const json& entry : said["cases"]) {
    for (const char* name : {"circulate", "find", "both"}) expect_times(entry, name);
    expect_number(entry, "found");
  }
  EXPECT_EQ(said["cases"][1]["vortices"], 2);
}

TEST(BenchCommands, LatencyByStageAndBySize) {
#ifdef NDEBUG
  const ScratchDirectory scratch;
  const ProgramRun one =
      run_curlew(scratch, "bench latency --rows 8 --cols 8 --window 6 --frames 50 --json");
  EXPECT_EQ(one.exit_code, 0) << one.err;
  const json said = json::parse(one.out, nullptr, false);
  for (const char* memory : {"warm", "cold"})
    for (const char* name :
         {"centroid", "slopes", "detect", "split", "total", "plain_rows", "read"})
      expect_times(said["cases"][0][memory], name);
  for (const char* name : {"read", "centroid", "total"})
    expect_number(said["cases"][0]["ns_per_lenslet"], name);
  const ProgramRun refused = run_curlew(scratch, "bench latency --scaling --rows 8");
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_NE(refused.err.find("--scaling"), std::string::npos) << refused.err;
#endif
}

TEST(BenchCommands, StreamedFramesBesideWholeOnes) {
#ifdef NDEBUG
  const ScratchDirectory scratch;
  const ProgramRun run =
      run_curlew(scratch, "bench stream --rows 8 --cols 8 --window 8 --rounds 20 --json");
  EXPECT_EQ(run.exit_code, 0) << run.err;
  const json said = json::parse(run.out, nullptr, false);
  EXPECT_EQ(said["cases"][0]["same_bits"], true);
  for (const char* name : {"whole", "streamed", "ahead", "slowest", "plain_rows", "read"})
    expect_times(said["cases"][0], name);
  const ProgramRun refused = run_curlew(scratch, "bench stream --rows 2 --cols 2 --window 8");
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_NE(refused.err.find("12 lenslets"), std::string::npos) << refused.err;
#endif
}

TEST(BenchCommands, CompareWithAnEarlierRun) {
#ifdef NDEBUG
  const ScratchDirectory scratch;
  const std::string command = "bench circulation --rows 8 --cols 8 --vortices 0 --rounds 20";
  const ProgramRun first = run_curlew(scratch, command + " --json");
  ASSERT_EQ(first.exit_code, 0) << first.err;
  std::ofstream((scratch / "old.json")) << first.out;
  const std::string compare = " --compare " + (scratch / "old.json");
  const json said = json::parse(run_curlew(scratch, command + " --json" + compare).out);
  ASSERT_EQ(said["compared"].size(), 3U);
  for (const json& figure : said["compared"]) EXPECT_GT(figure["ratio"], 0.0);
  const ProgramRun text = run_curlew(scratch, command + compare);
  EXPECT_NE(text.out.find("of 3 figures have changed"), std::string::npos) << text.out;
  const ProgramRun other =
      run_curlew(scratch, "bench circulation --rows 9 --cols 8 --vortices 0 --rounds 20" + compare);
  EXPECT_EQ(other.exit_code, 1);
  EXPECT_NE(other.err.find("old.json"), std::string::npos) << other.err;
#endif
}

TEST(BenchCommands, TablesForPeople) {
#ifdef NDEBUG
  const ScratchDirectory scratch;
  for (const char* command : {"centroid --rows 3 --cols 4 --window 7", "split --rows 8 --cols 8",
                              "circulation --rows 8 --cols 8"}) {
    const ProgramRun run = run_curlew(scratch, std::string("bench ") + command + " --quick");
    EXPECT_EQ(run.exit_code, 0) << run.err;
    EXPECT_NE(run.out.find("median"), std::string::npos) << run.out;
  }
#endif
}

}  // namespace
}  // namespace curlew
