// The figures for Prometheus, and the server that nobody can hold up.
#include <gtest/gtest.h>

#include <chrono>
#include <map>
#include <sstream>
#include <vector>

#include "core/error.h"
#include "service/metrics/metrics_server.h"
#include "service/metrics/metrics_text.h"
#include "tests/support/failure_text.h"
#include "tests/support/http.h"

namespace curlew {
namespace {

const char* const kGet = "GET /metrics HTTP/1.1\r\nHost: here\r\n\r\n";

/// Returns the samples of a text by their names with labels.
std::map<std::string, double> samples(const std::string& text) {
  std::map<std::string, double> found;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    const std::size_t space = line.rfind(' ');
    if (line[0] != '#') found[line.substr(0, space)] = std::stod(line.substr(space + 1));
  }
  return found;
}

TEST(Metrics, HistogramsAreCumulativeAndInSeconds) {
  LiveMetrics live;
  const std::int64_t times_ns[] = {999, 1'000, 1'001, 90'000, 100'000, 7'000'000'000};
  for (const std::int64_t ns : times_ns) live.stages[0].add(ns);
  const std::string text = metrics_text(live, {});
  EXPECT_EQ(text.back(), '\n');
  auto found = samples(text);
  const auto bucket = [&](const std::string& bound) {
    return found.at("curlew_stage_latency_seconds_bucket{stage=\"centroid\",le=\"" + bound + "\"}");
  };
  EXPECT_EQ(bucket("1e-06"), 2);
  EXPECT_EQ(bucket("2.5e-06"), 3);
  EXPECT_EQ(bucket("0.0001"), 5);
  EXPECT_EQ(bucket("2.5"), 5);
  EXPECT_EQ(bucket("+Inf"), 6);
  EXPECT_EQ(found.at("curlew_stage_latency_seconds_count{stage=\"centroid\"}"), 6);
  EXPECT_NEAR(found.at("curlew_stage_latency_seconds_sum{stage=\"centroid\"}"), 7.000193, 1e-9);
}

TEST(Metrics, EveryFrameHasOneOutcome) {
  StatusSnapshot status;
  status.results = 1;
  status.counts.superseded = 2;
  status.counts.unprocessed = 4;
  status.counts.frames = {.delivered = 7,
                          .incomplete = 8,
                          .timed_out = 16,
                          .aborted = 32,
                          .wrong_size = 64,
                          .other = 128,
                          .lost = 256,
                          .no_buffer = 3};
  status.state = DaemonState::kStreaming;
  double sum = 0;
  int outcomes = 0;
  const auto found = samples(metrics_text({}, status));
  for (const auto& [name, value] : found)
    if (name.rfind("curlew_frames_total{", 0) == 0) {
      sum += value;
      ++outcomes;
    }
  EXPECT_EQ(sum, 511);
  EXPECT_EQ(outcomes, 9);
  EXPECT_EQ(found.at("curlew_state{state=\"streaming\"}"), 1);
  EXPECT_EQ(found.at("curlew_state{state=\"lost\"}"), 0);
}

TEST(Metrics, TellOfTheAirWhatIsKnown) {
  StatusSnapshot status;
  EXPECT_EQ(metrics_text({}, status).find("curlew_air"), std::string::npos);
  status.air.emplace();
  status.air->figures.scintillation = {0.25, 0.01};
  auto found = samples(metrics_text({}, status));
  EXPECT_EQ(found.at("curlew_air{figure=\"scintillation_index\"}"), 0.25);
  EXPECT_EQ(found.at("curlew_air_error{figure=\"scintillation_index\"}"), 0.01);
  EXPECT_EQ(found.count("curlew_air{figure=\"r0_pitches\"}"), 0U) << "it is not known";
  status.state = DaemonState::kNoLight;
  EXPECT_EQ(samples(metrics_text({}, status)).at("curlew_state{state=\"no light\"}"), 1);
}

class MetricsServerTest : public ::testing::Test {
 protected:
  MetricsServer server_{{.listen = "127.0.0.1:0"}, [] { return std::string("a 1\n"); }};
  std::string ask(const std::string& request) const { return ask_http(server_.port(), request); }
};

TEST_F(MetricsServerTest, AnswersAsPrometheusWantsIt) {
  const std::string answer = ask(kGet);
  EXPECT_EQ(answer.rfind("HTTP/1.1 200 OK\r\n", 0), 0U) << answer;
  EXPECT_NE(answer.find("Content-Type: text/plain; version=0.0.4"), std::string::npos);
  EXPECT_NE(answer.find("Content-Length: 4\r\n"), std::string::npos);
  EXPECT_EQ(answer.substr(answer.size() - 8), "\r\n\r\na 1\n");
  EXPECT_EQ(ask("HEAD /metrics HTTP/1.1\r\n\r\n").find("a 1"), std::string::npos);
}

TEST_F(MetricsServerTest, RefusesEverythingElse) {
  EXPECT_EQ(ask("GET / HTTP/1.1\r\n\r\n").substr(9, 3), "404");
  EXPECT_EQ(ask("GET /metricsx HTTP/1.1\r\n\r\n").substr(9, 3), "404");
  EXPECT_EQ(ask("POST /metrics HTTP/1.1\r\n\r\n").substr(9, 3), "405");
  EXPECT_EQ(ask("hello\r\n\r\n").substr(9, 3), "400");
  EXPECT_EQ(ask(std::string("\0\xff  \r\n\r\n", 8)).substr(9, 3), "400");
  std::string endless = "GET /metrics HTTP/1.1\r\nX: ";
  endless.append(kLongestHead, 'x');
  EXPECT_EQ(ask(endless).substr(9, 3), "431");
}

TEST_F(MetricsServerTest, SilentAndSlowClientsHoldNobodyUp) {
  std::vector<std::unique_ptr<LocalConnection>> idle;
  for (int i = 0; i < 100; ++i) {
    idle.push_back(std::make_unique<LocalConnection>(server_.port()));
    ASSERT_TRUE(idle.back()->connected()) << i;
    if (i % 2 == 0) idle.back()->send("GET /metr");
    if (i % 10 != 9) continue;
    ASSERT_NE(ask(kGet).find("a 1"), std::string::npos) << i;
  }
  EXPECT_EQ(idle.front()->receive(), "") << "the oldest had to go";
}

TEST(MetricsServers, ListenOnlyWhereTheyMay) {
  const auto text = [] { return std::string(); };
  const auto refusal = [&](const std::string& listen) {
    try {
      const MetricsServer server({.listen = listen}, text);
    } catch (const UsageError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  for (const char* listen :
       {"", "9464", "127.0.0.1", "127.0.0.1:", ":9464", "somewhere:1", "1.2.3:x"})
    EXPECT_NE(refusal(listen).find("is no numeric address and port"), std::string::npos) << listen;
  for (const char* listen : {"0.0.0.0:0", "[::]:0", "192.0.2.1:0"})
    EXPECT_NE(refusal(listen).find("lies beyond loopback"), std::string::npos) << listen;
  EXPECT_EQ(refusal("localhost:0"), "");
  EXPECT_GT(MetricsServer({"0.0.0.0:0", true}, text).port(), 0);
  const MetricsServer first({.listen = "127.0.0.1:0"}, text);
  const std::string taken = "127.0.0.1:" + std::to_string(first.port());
  EXPECT_NE(failure_text([&] {
              const MetricsServer second({.listen = taken}, text);
            }).find("set another listen in section [metrics]"),
            std::string::npos);
}

}  // namespace
}  // namespace curlew
