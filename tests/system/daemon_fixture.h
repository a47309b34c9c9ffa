// This runs the daemon as a user runs it: in another process, with a camera over real packets on
// loopback.
#pragma once

#include <gtest/gtest.h>

#include <cctype>
#include <chrono>
#include <cstdint>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tests/support/fake_gige_camera.h"
#include "tests/support/loopback.h"
#include "tests/support/paths.h"
#include "tests/support/process.h"
#include "tests/support/program.h"
#include "tests/support/sanitized.h"

namespace curlew {

constexpr int kDistinctFrames = 60;

inline std::vector<nlohmann::json> json_lines(const std::string& path) {
  std::vector<nlohmann::json> lines;
  std::ifstream file(path);
  for (std::string line; std::getline(file, line);) lines.push_back(nlohmann::json::parse(line));
  return lines;
}

/// Returns the number before `words` in the text; −1 where there is none.
inline std::int64_t number_before(const std::string& text, const std::string& words) {
  const std::size_t at = text.find(words);
  if (at == std::string::npos) return -1;
  std::size_t begin = at;
  while (begin > 0 && std::isdigit(static_cast<unsigned char>(text[begin - 1])) != 0) --begin;
  return begin == at ? -1 : std::stoll(text.substr(begin, at - begin));
}

/// The account that the daemon prints at its end.
struct Account {
  explicit Account(const std::string& out)
      : delivered(number_before(out, " frames delivered")),
        results(number_before(out, " results +")),
        superseded(number_before(out, " superseded")),
        unprocessed(number_before(out, " not processed")),
        lost(number_before(out, " lost (")),
        incomplete(number_before(out, " incomplete")),
        connections(number_before(out, " connections")) {}
  std::int64_t delivered, results, superseded, unprocessed, lost, incomplete, connections;
};

inline void expect_balanced(const Account& account) {
  EXPECT_GE(account.results, 0);
  EXPECT_EQ(account.delivered, account.results + account.superseded + account.unprocessed);
}

class Daemon : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { claim_loopback(); }

  void run(const std::string& arguments) {
    const ProgramRun program = run_curlew(scratch_, arguments);
    ASSERT_EQ(program.exit_code, 0) << arguments << "\n" << program.err;
  }
  void make_sensor_and_recording() {
    const std::string size = "--rows 12 --cols 12 --window 8 ";
    run("simulate --preset plane " + size + "--frames 20 --photons 20000 --bits 14 --out ref.fits");
    run("calibrate ref.fits --out sensor.fits");
    run("simulate --preset vortex " + size +
        "--amplitude linear --core-radius 1.5 --vortex 3.4,2.6,+1 --vortex 8.7,8.2,-1 "
        "--velocity 0.02,0.01 --photons 1500 --seed 7701 --out beam.fits --frames " +
        std::to_string(kDistinctFrames));
  }
  std::unique_ptr<Process> serve(const std::vector<std::string>& more = {},
                                 const std::string& recording = "beam.fits") {
    std::vector<std::string> command{kServeGige, scratch_ / recording};
    command.insert(command.end(), more.begin(), more.end());
    auto server =
        std::make_unique<Process>(command, scratch_ / "server.out", scratch_ / "server.err");
    EXPECT_TRUE(server->says("ready", std::chrono::seconds(20))) << server->err();
    return server;
  }
  std::unique_ptr<Process> daemon(const std::vector<std::string>& more,
                                  void (*before_exec)() = nullptr) {
    std::vector<std::string> command{kCurlewProgram, "run"};
    command.insert(command.end(), more.begin(), more.end());
    return std::make_unique<Process>(command, scratch_ / "daemon.out", scratch_ / "daemon.err",
                                     before_exec);
  }
  /// Returns the lines that replay writes for the recording's frames, in their order.
  std::vector<nlohmann::json> replayed() {
    run("replay beam.fits --sensor sensor.fits --jsonl replay.jsonl");
    return json_lines(scratch_ / "replay.jsonl");
  }
  /// Expects every result to be, to the last digit, that of the recording's frame that it shows.
  void expect_as_replayed(const std::string& jsonl) {
    const std::vector<nlohmann::json> truth = replayed();
    ASSERT_EQ(truth.size(), static_cast<std::size_t>(kDistinctFrames));
    std::size_t vortices = 0;
    for (const nlohmann::json& line : json_lines(jsonl)) {
      const std::size_t image =
          FakeGigeCamera::image_of(line["sequence"].get<std::int64_t>(), kDistinctFrames);
      ASSERT_EQ(line["vortices"].dump(), truth[image]["vortices"].dump()) << line["sequence"];
      ASSERT_EQ(line["n_valid"], truth[image]["n_valid"]);
      vortices += line["vortices"].size();
    }
    EXPECT_GT(vortices, 100U) << "there must be vortices to compare";
  }

  ScratchDirectory scratch_;
};

}  // namespace curlew
