// The daemon as a user runs it: in another process, with a camera over real packets on loopback.
#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <random>

#include "service/daemon/control_socket.h"
#include "tests/support/fake_gige_camera.h"
#include "tests/support/loopback.h"
#include "tests/support/process.h"
#include "tests/support/program.h"

namespace curlew {
namespace {

using nlohmann::json;
using std::chrono::seconds;

constexpr int kDistinctFrames = 60;
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool kSanitized = true;
#else
constexpr bool kSanitized = false;
#endif

std::vector<json> json_lines(const std::string& path) {
  std::vector<json> lines;
  std::ifstream file(path);
  for (std::string line; std::getline(file, line);) lines.push_back(json::parse(line));
  return lines;
}

/// Returns the number before `words` in the text.
std::int64_t number_before(const std::string& text, const std::string& words) {
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

void expect_balanced(const Account& account) {
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
  std::unique_ptr<Process> serve(const std::vector<std::string>& more = {}) {
    std::vector<std::string> command{CURLEW_SERVE_GIGE, scratch_ / "beam.fits"};
    command.insert(command.end(), more.begin(), more.end());
    auto server =
        std::make_unique<Process>(command, scratch_ / "server.out", scratch_ / "server.err");
    EXPECT_TRUE(server->says("ready", seconds(20))) << server->err();
    return server;
  }
  std::unique_ptr<Process> daemon(const std::vector<std::string>& more,
                                  void (*before_exec)() = nullptr) {
    std::vector<std::string> command{CURLEW_PROGRAM, "run"};
    command.insert(command.end(), more.begin(), more.end());
    return std::make_unique<Process>(command, scratch_ / "daemon.out", scratch_ / "daemon.err",
                                     before_exec);
  }
  /// Returns the lines that replay writes for the recording's frames, in their order.
  std::vector<json> replayed() {
    run("replay beam.fits --sensor sensor.fits --jsonl replay.jsonl");
    return json_lines(scratch_ / "replay.jsonl");
  }
  /// Expects every result to be, to the last digit, that of the recording's frame that it shows.
  void expect_as_replayed(const std::string& jsonl) {
    const std::vector<json> truth = replayed();
    ASSERT_EQ(truth.size(), static_cast<std::size_t>(kDistinctFrames));
    std::size_t vortices = 0;
    for (const json& line : json_lines(jsonl)) {
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

TEST_F(Daemon, VorticesOverGigeVisionAreThoseOfReplay) {
  make_sensor_and_recording();
  const auto server = serve({"--rate", "200"});
  const auto curlew = daemon({"--camera", "aravis:127.0.0.1", "--sensor", scratch_ / "sensor.fits",
                              "--jsonl", scratch_ / "live.jsonl", "--frames", "300"});
  ASSERT_EQ(curlew->wait(seconds(60)), 0) << curlew->err();
  const Account account(curlew->out());
  expect_balanced(account);
  EXPECT_EQ(account.results, 300);
  EXPECT_EQ(json_lines(scratch_ / "live.jsonl").size(), 300U);
  expect_as_replayed(scratch_ / "live.jsonl");
}

class DaemonLoss : public Daemon, public ::testing::WithParamInterface<const char*> {};

TEST_P(DaemonLoss, IncompleteFramesAreCountedAndNeverProcessed) {
  make_sensor_and_recording();
  const auto server = serve({"--rate", "300", "--lost-ratio", GetParam()});
  const std::string config = scratch_ / "small_packets.toml";
  write_bytes(config, "[camera]\npacket_size_bytes = 1400\n");  // makes 14 packets a frame
  const auto curlew =
      daemon({"--config", config, "--camera", "aravis:127.0.0.1", "--sensor",
              scratch_ / "sensor.fits", "--jsonl", scratch_ / "live.jsonl", "--frames", "1500"});
  ASSERT_EQ(curlew->wait(seconds(60)), 0) << curlew->err();
  const Account account(curlew->out());
  expect_balanced(account);
  EXPECT_EQ(account.results, 1500);
  EXPECT_GT(account.incomplete + account.lost, 0);
  expect_as_replayed(scratch_ / "live.jsonl");
  std::printf("lost packets %s: %lld incomplete, %lld lost\n%s", GetParam(),
              static_cast<long long>(account.incomplete), static_cast<long long>(account.lost),
              curlew->out().c_str());
}

INSTANTIATE_TEST_SUITE_P(PacketLoss, DaemonLoss, ::testing::Values("0.0005", "0.01"),
                         [](const auto& ratio) {
                           return std::string(ratio.param) == "0.01" ? "one_percent"
                                                                     : "half_a_permille";
                         });

TEST_F(Daemon, ACameraThatDiesAndReturnsIsFoundEveryTime) {
  make_sensor_and_recording();
  const unsigned seed = std::random_device{}();
  std::printf("seed %u\n", seed);
  std::mt19937 random(seed);
  const std::string config = scratch_ / "impatient.toml";
  const std::string socket = scratch_ / "control";
  write_bytes(config, "[camera]\ntimeout_s = 0.5\nmax_backoff_s = 0.2\n[daemon]\ncontrol = \"" +
                          socket + "\"\n");
  const auto curlew = daemon({"--config", config, "--camera", "aravis:127.0.0.1", "--sensor",
                              scratch_ / "sensor.fits", "--jsonl", scratch_ / "live.jsonl"});
  ASSERT_TRUE(curlew->says("state=searching", seconds(20))) << curlew->err();
  const auto status = [&](const char* what) {
    return json::parse(ask_daemon(socket, "status"))[what].get<std::int64_t>();
  };
  int threads_then = 0;
  int files_then = 0;
  std::int64_t long_lives = 0;
  for (int life = 0; life < 20; ++life) {
    const std::int64_t connections = status("connections");
    const auto server = serve({"--rate", "200"});
    // Some lives end while the camera is being opened, and the others while it streams.
    if (life % 4 != 3) {
      ++long_lives;
      const auto until = std::chrono::steady_clock::now() + seconds(20);
      while (status("connections") == connections && std::chrono::steady_clock::now() < until)
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
      const std::int64_t results = status("results");
      while (status("results") == results && std::chrono::steady_clock::now() < until)
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
      ASSERT_GT(status("results"), results) << "life " << life << "\n" << curlew->err();
      if (life == 4) {
        threads_then = curlew->threads();
        files_then = curlew->open_files();
      }
      if (life == 18) {
        // A leak would leave ten or more in these lives. A few belong to Aravis while it lets go.
        EXPECT_LE(curlew->threads(), threads_then + 3) << "threads are left behind";
        EXPECT_LE(curlew->open_files(), files_then + 3) << "files are left open";
      }
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(random() % 400));
    server->signal(SIGKILL);
    server->wait(seconds(5));
  }
  curlew->signal(SIGTERM);
  ASSERT_EQ(curlew->wait(seconds(30)), 0) << curlew->err();
  const Account account(curlew->out());
  expect_balanced(account);
  EXPECT_GE(account.connections, long_lives);
  EXPECT_EQ(account.results, static_cast<std::int64_t>(json_lines(scratch_ / "live.jsonl").size()));
  expect_as_replayed(scratch_ / "live.jsonl");
}

// systemd does not start the service again after exit code 2.
TEST_F(Daemon, WhatWouldBeSoAgainAtTheNextStartIsAMatterOfConfiguration) {
  const auto expect_usage = [&](const std::string& config, const std::string& words) {
    write_bytes(scratch_ / "c.toml", config);
    const auto curlew = daemon({"--config", scratch_ / "c.toml", "--seconds", "5"});
    EXPECT_EQ(curlew->wait(seconds(60)), 2) << curlew->err();
    EXPECT_NE(curlew->err().find(words), std::string::npos) << curlew->err();
  };
  const std::string camera = "[camera]\nsource = \"sim:vortex\"\n";
  expect_usage(camera + "[daemon]\nsensor = \"/none/sensor.fits\"\n",
               "/none/sensor.fits does not exist");
  expect_usage(camera + "[daemon]\ncontrol = \"/none/control\"\n",
               "the folder /none does not exist; make it");
  expect_usage(camera + "[recorder]\nmode = \"continuous\"\nfolder = \"/none\"\n",
               "/none does not exist: make it");
  expect_usage(camera + "[daemon]\njsonl = \"/none/a.jsonl\"\n", "/none/a.jsonl");
}

TEST_F(Daemon, StopsWhileItOpensOrSearches) {
  make_sensor_and_recording();
  for (const int milliseconds : {0, 50, 150, 300, 700}) {
    const auto curlew =
        daemon({"--camera", "aravis:127.0.0.1", "--sensor", scratch_ / "sensor.fits"});
    const int number = milliseconds % 100 == 0 ? SIGTERM : SIGINT;
    ASSERT_TRUE(curlew->catches(number, seconds(20)));
    std::this_thread::sleep_for(std::chrono::milliseconds(milliseconds));
    curlew->signal(number);
    EXPECT_EQ(curlew->wait(seconds(20)), 0) << curlew->err();
  }
}

TEST_F(Daemon, ReloadKeepsTheOldPlanWhereTheNewOneIsBad) {
  make_sensor_and_recording();
  const std::string config = scratch_ / "curlew.toml";
  const std::string camera =
      "[camera]\nsource = \"sim:vortex\"\nframe_rate_hz = 500\n[daemon]\njsonl = \"" +
      (scratch_ / "live.jsonl") + "\"\n";
  write_bytes(config, camera);
  const auto curlew = daemon({"--config", config});
  ASSERT_TRUE(curlew->says("state=streaming", seconds(20))) << curlew->err();

  write_bytes(config, camera + "[detect]\nfalse_alarms_per_frame = \"many\"\n");
  curlew->signal(SIGHUP);
  EXPECT_TRUE(curlew->says("false_alarms_per_frame must be a number", seconds(20)));
  EXPECT_TRUE(curlew->says("the old plan stays", seconds(20)));

  write_bytes(config, camera + "sensor = \"" + (scratch_ / "ref.fits") + "\"\n");
  curlew->signal(SIGHUP);
  EXPECT_TRUE(curlew->says("is no sensor file", seconds(20))) << curlew->err();

  write_bytes(config, camera + "[detect]\nmin_circulation_rad = 99\n");
  curlew->signal(SIGHUP);
  EXPECT_TRUE(curlew->says("are in use", seconds(20))) << curlew->err();
  std::this_thread::sleep_for(seconds(1));
  curlew->signal(SIGTERM);
  ASSERT_EQ(curlew->wait(seconds(30)), 0) << curlew->err();
  expect_balanced(Account(curlew->out()));
  EXPECT_EQ(Account(curlew->out()).lost, 0);
  const std::vector<json> lines = json_lines(scratch_ / "live.jsonl");
  ASSERT_GT(lines.size(), 100U);
  EXPECT_EQ(lines.front()["vortices"].size(), 1U) << "the old plan must find the vortex";
  EXPECT_EQ(lines.back()["vortices"].size(), 0U) << "the new plan must not find it";
}

// Frames of 512×512 u16 come as fast as the fake camera sends. What the machine's other work makes
// the kernel drop is counted. What must never happen is that the camera finds no buffer of ours.
TEST_F(Daemon, TheCameraAlwaysFindsABufferAtFullRate) {
  const char* asked = std::getenv("CURLEW_FULL_RATE_SECONDS");
  const std::string length_s = asked == nullptr ? "5" : asked;
  const std::string size = "--rows 32 --cols 32 --window 16 ";
  run("simulate --preset plane " + size + "--frames 20 --photons 50000 --bits 16 --out ref.fits");
  run("calibrate ref.fits --out sensor.fits");
  run("simulate --preset vortex " + size + "--photons 5000 --frames 20 --out beam.fits");
  const auto server = serve({"--rate", "2000"});
  const std::string config = scratch_ / "large_packets.toml";
  write_bytes(config, "[camera]\npacket_size_bytes = 8192\n");
  const auto curlew = daemon({"--config", config, "--camera", "aravis:127.0.0.1", "--sensor",
                              scratch_ / "sensor.fits", "--seconds", length_s});
  ASSERT_EQ(curlew->wait(seconds(120)), 0) << curlew->err();
  const Account account(curlew->out());
  expect_balanced(account);
  EXPECT_GT(account.results, 100);
  EXPECT_EQ(number_before(curlew->out(), " for want of a buffer"), 0);
  std::printf("512 x 512 Mono16, %s s\n%s", length_s.c_str(), curlew->out().c_str());
}

void become_nobody() {
  constexpr unsigned kNobody = 65534;
  if (geteuid() == 0 && (setgid(kNobody) != 0 || setuid(kNobody) != 0)) _exit(126);
}

TEST_F(Daemon, AnOrdinaryUserIsToldOnceWhatWasRefused) {
  std::filesystem::permissions(scratch_.path(), std::filesystem::perms::all);
  const std::string config = scratch_ / "realtime.toml";
  write_bytes(config,
              "[camera]\nsource = \"sim:vortex\"\n[realtime]\npriority = 50\ncamera_priority = 60\n"
              "lock_memory = true\nmax_cpu_wakeup_us = 0\n");
  const auto curlew = daemon({"--config", config, "--frames", "200"}, become_nobody);
  ASSERT_EQ(curlew->wait(seconds(60)), 0) << curlew->err();
  const std::string log = curlew->err();
  expect_balanced(Account(curlew->out()));
  EXPECT_EQ(Account(curlew->out()).results, 200);
  // Whatever this machine grants to a nobody, nothing is said twice.
  std::map<std::string, int> told;
  std::istringstream lines(log);
  for (std::string line; std::getline(lines, line);)
    if (const std::size_t at = line.find("warning: "); at != std::string::npos)
      ++told[line.substr(at)];
  for (const auto& [sentence, times] : told) EXPECT_EQ(times, 1) << sentence;
  if (geteuid() == 0) {
    EXPECT_GE(told.size(), 2U) << log;
  }
}

TEST_F(Daemon, SoakKeepsItsAccountsAndItsMemory) {
  const char* asked = std::getenv("CURLEW_SOAK_SECONDS");
  const int length_s = asked == nullptr ? 20 : std::stoi(asked);
  const auto curlew = daemon(
      {"--camera", "sim:dipole", "--jsonl", "/dev/null", "--seconds", std::to_string(length_s)});
  std::this_thread::sleep_for(seconds(length_s / 4 + 3));
  const long memory_then = curlew->memory_kb();
  std::this_thread::sleep_for(seconds(length_s / 2));
  const long memory_now = curlew->memory_kb();
  ASSERT_EQ(curlew->wait(seconds(length_s + 60)), 0) << curlew->err();
  const Account account(curlew->out());
  expect_balanced(account);
  EXPECT_GT(account.results, 100 * length_s) << "it must reach a tenth of the rate at least";
  EXPECT_EQ(account.lost, 0) << "the pipeline must always leave the camera a buffer";
  if (!kSanitized) {  // a sanitizer keeps what was freed, and more of it with time
    EXPECT_LT(memory_now, memory_then + 2048)
        << "resident kB must not grow from a quarter of the time to the end";
  }
  std::printf("%d s: %lld delivered, %lld results, %lld superseded, memory %ld kB then, %ld now\n",
              length_s, static_cast<long long>(account.delivered),
              static_cast<long long>(account.results), static_cast<long long>(account.superseded),
              memory_then, memory_now);
}

TEST_F(Daemon, ControlSocketTellsAndRefuses) {
  const std::string config = scratch_ / "control.toml";
  write_bytes(config, "[camera]\nsource = \"sim:vortex\"\n[daemon]\ncontrol = \"" +
                          (scratch_ / "control") + "\"\n");
  const auto curlew = daemon({"--config", config});
  ASSERT_TRUE(curlew->says("state=streaming", seconds(20))) << curlew->err();
  const auto ask = [&](const std::string& word) {
    return run_curlew(scratch_, "control " + word + " --socket " + (scratch_ / "control"));
  };
  const json status = json::parse(ask("status").out);
  EXPECT_GE(status["results"].get<std::int64_t>(), 0);
  EXPECT_EQ(status["connections"], 1);
  EXPECT_EQ(ask("trigger").exit_code, 1) << "a trigger must fail where nothing is recorded";
  EXPECT_NE(ask("nonsense").err.find("not 'nonsense'"), std::string::npos);
  const auto second = daemon({"--config", config});
  EXPECT_EQ(second->wait(seconds(20)), 1);
  EXPECT_NE(second->err().find("another curlew listens"), std::string::npos) << second->err();
  curlew->signal(SIGTERM);
  EXPECT_EQ(curlew->wait(seconds(20)), 0);
  EXPECT_FALSE(std::filesystem::exists(scratch_ / "control"));
}

}  // namespace
}  // namespace curlew
