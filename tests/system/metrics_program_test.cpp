// The daemon's metrics as Prometheus' own tool reads them.
#include <gtest/gtest.h>

#include <cstdlib>
#include <regex>

#include "tests/support/http.h"
#include "tests/support/paths.h"
#include "tests/support/process.h"
#include "tests/support/program.h"

namespace curlew {
namespace {

using std::chrono::seconds;

/// Runs promtool; its exit code, 127 if there is none on this machine.
int promtool(const std::string& arguments) {
  const int status = std::system(("promtool " + arguments).c_str());
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

TEST(MetricsProgram, PromtoolAcceptsWhatTheDaemonSays) {
  const ScratchDirectory scratch;
  write_bytes(scratch / "c.toml", "[metrics]\nlisten = \"127.0.0.1:0\"\n");
  Process curlew({kCurlewProgram, "run", "--camera", "sim:dipole", "--config", scratch / "c.toml"},
                 scratch / "out", scratch / "err");
  ASSERT_TRUE(curlew.says("streaming", seconds(20))) << curlew.err();
  std::smatch port;
  const std::string log = curlew.err();
  ASSERT_TRUE(std::regex_search(log, port, std::regex("metrics: answered at port (\\d+)"))) << log;
  std::string answer;
  for (int i = 0; i < 100; ++i) {
    answer = ask_http(std::stoi(port[1]), "GET /metrics HTTP/1.1\r\nHost: localhost\r\n\r\n");
    if (!std::regex_search(answer, std::regex("outcome=\"result\"\\} 0\n"))) break;
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  const std::string text = answer.substr(answer.find("\r\n\r\n") + 4);
  std::smatch results;
  ASSERT_TRUE(std::regex_search(
      text, results, std::regex("curlew_frames_total\\{outcome=\"result\"\\} (\\d+)\n")));
  EXPECT_GT(std::stoi(results[1]), 0);
  EXPECT_NE(text.find("curlew_state{state=\"streaming\"} 1\n"), std::string::npos);
  EXPECT_TRUE(std::regex_search(text, std::regex("curlew_vortices [1-9]")));
  write_bytes(scratch / "metrics", text);
  const int verdict = promtool("check metrics <'" + (scratch / "metrics") + "'");
  if (verdict == 127) GTEST_SKIP() << "promtool is not installed";
  EXPECT_EQ(verdict, 0) << text;
  EXPECT_EQ(promtool(std::string("check rules '") + kSourceDir + "/docs/metrics/alerts.yml'"), 0);
}

TEST(MetricsProgram, AnAddressBeyondLoopbackHasToBeAllowed) {
  const ScratchDirectory scratch;
  write_bytes(scratch / "c.toml", "[metrics]\nlisten = \"0.0.0.0:0\"\n");
  const ProgramRun run = run_curlew(scratch, "run --camera sim:dipole --config c.toml --frames 1");
  EXPECT_EQ(run.exit_code, 2);
  EXPECT_NE(run.err.find("lies beyond loopback; set beyond_loopback = true"), std::string::npos);
}

}  // namespace
}  // namespace curlew
