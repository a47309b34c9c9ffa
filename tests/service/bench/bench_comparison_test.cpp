#include "service/bench/bench_comparison.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>
#include <string>
#include <vector>

#include "core/error.h"
#include "service/bench/timed_rounds.h"
#include "tests/support/scratch_directory.h"

namespace curlew {
namespace {

using Json = nlohmann::ordered_json;

/// Rounds that take `us` with noise of `noise` of it, on a machine that is `slowness` times as
/// slow.
std::vector<double> rounds(double us, double noise, double slowness, std::mt19937_64& random) {
  std::normal_distribution<double> normal(1.0, noise);
  std::vector<double> times(300);
  for (double& time : times) time = slowness * us * std::max(normal(random), 0.1);
  return times;
}

/// A run of a benchmark whose kernel takes kernel_us, and a read of the frame 10 µs.
Json run_of(double kernel_us, double slowness, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  Json json;
  Json entry = {{"rows", 8}, {"cols", 9}, {"pixels", "u16"}};
  entry["warm"]["kernel"] = times_json(summarise(rounds(kernel_us, 0.05, slowness, random)));
  entry["warm"]["read"] = times_json(summarise(rounds(10.0, 0.05, slowness, random)));
  json["cases"].push_back(entry);
  return json;
}

const ComparedFigure& kernel_of(const std::vector<ComparedFigure>& compared) {
  return compared.front().name.find("kernel") != std::string::npos ? compared.front()
                                                                   : compared.back();
}

TEST(BenchComparison, TellsNoiseFromChange) {
  constexpr std::uint64_t kPairs = 200;
  int changes = 0, slower = 0, faster = 0;
  for (std::uint64_t seed = 0; seed < 2 * kPairs; seed += 2) {
    const Json before = run_of(100.0, 1.0, seed);
    const auto change_at = [&](double kernel_us) {
      return kernel_of(compare_figures(before, run_of(kernel_us, 1.0, seed + 1))).change;
    };
    changes += change_at(100.0) == FigureChange::kSame ? 0 : 1;
    slower += change_at(106.0) == FigureChange::kSlower ? 1 : 0;
    faster += change_at(94.0) == FigureChange::kFaster ? 1 : 0;
    EXPECT_EQ(change_at(115.0), FigureChange::kSlower);
  }
  EXPECT_LE(changes, 1);
  EXPECT_GE(slower, 194);  // A simulation finds 99.6 % of such changes.
  EXPECT_GE(faster, 194);
}

TEST(BenchComparison, AMachineThatIsSlowerAsAWholeChangesOnlyTheReadItself) {
  const auto compared = compare_figures(run_of(100.0, 1.0, 1), run_of(100.0, 1.5, 2));
  ASSERT_EQ(compared.size(), 2U);
  const ComparedFigure& kernel = kernel_of(compared);
  EXPECT_NE(kernel.name.find(" 8 9 u16"), std::string::npos) << kernel.name;
  EXPECT_TRUE(kernel.over_read);
  EXPECT_EQ(kernel.change, FigureChange::kSame);
  EXPECT_NEAR(kernel.now_us / kernel.before_us, 1.5, 0.05);
  EXPECT_NEAR(kernel.ratio, 1.0, 0.04);
}

TEST(BenchComparison, AFewRoundsTellNothing) {
  Json before = run_of(100.0, 1.0, 1);
  before["cases"][0]["warm"]["kernel"] = times_json(summarise({100.0, 101.0, 99.0}));
  before["cases"][0]["warm"]["read"] = times_json(summarise({10.0, 10.0, 10.0}));
  EXPECT_EQ(kernel_of(compare_figures(before, run_of(200.0, 1.0, 2))).change,
            FigureChange::kUnsure);
}

TEST(BenchComparison, OtherSizesAreNotCompared) {
  Json other = run_of(100.0, 1.0, 1);
  other["cases"][0]["rows"] = 7;
  EXPECT_TRUE(compare_figures(other, run_of(100.0, 1.0, 2)).empty());
}

TEST(BenchComparison, FilesThatHoldNoFiguresAreRefusedByName) {
  const ScratchDirectory scratch;
  const auto refused = [&](const std::string& text) {
    const std::string path = (scratch / "old.json");
    std::ofstream(path) << text;
    try {
      read_figures(path);
    } catch (const Failure& failure) {
      return std::string(failure.what()).find("old.json") != std::string::npos;
    }
    return false;
  };
  for (const char* text : {"", "[", "17", "{}", "{\"cases\": 1", "\xff\xfe"})
    EXPECT_TRUE(refused(text)) << text;
  EXPECT_THROW(read_figures((scratch / "missing.json")), Failure);
  // What looks like a figure and is none is left out.
  const Json odd = Json::parse(
      R"({"cases": [{"rows": [], "a": {"median_us": "x", "parts_us": [1]}, "b": {"median_us": 1,
          "parts_us": [0, -1]}, "read": {"median_us": 1, "parts_us": []}}, 3, null]})");
  EXPECT_TRUE(compare_figures(odd, odd).empty());
}

TEST(RoundTimes, PartsFollowOneAnother) {
  std::vector<double> us;
  for (int i = 0; i < 100; ++i) us.push_back(i / 10);
  const RoundTimes times = summarise(us);
  ASSERT_EQ(times.part_median_us.size(), kTimedParts);
  for (std::size_t part = 0; part < kTimedParts; ++part)
    EXPECT_EQ(times.part_median_us[part], static_cast<double>(part));
  EXPECT_EQ(summarise({3.0, 1.0}).part_median_us, (std::vector<double>{3.0, 1.0}));
}

}  // namespace
}  // namespace curlew
