// The daemon's results, states, reloads and exit codes.
#include <cstdio>
#include <cstdlib>
#include <map>
#include <random>
#include <sstream>

#include "service/daemon/control_socket.h"
#include "tests/system/daemon_fixture.h"

namespace curlew {
namespace {

using nlohmann::json;
using std::chrono::seconds;

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

// Frames of another shape are never worked on, and when those of before come, all goes on.
TEST_F(Daemon, ACameraThatReturnsWithOtherFramesIsRefusedOnceAndWaitedFor) {
  make_sensor_and_recording();
  const std::string other = "simulate --preset vortex --frames 3 --window 8 --photons 1500 ";
  run(other + "--rows 11 --cols 12 --out smaller.fits");
  run(other + "--rows 12 --cols 12 --bits 8 --out bytes.fits");
  const std::string config = scratch_ / "c.toml";
  const std::string socket = scratch_ / "control";
  write_bytes(config, "[camera]\ntimeout_s = 0.5\nmax_backoff_s = 0.2\n[daemon]\ncontrol = \"" +
                          socket + "\"\n");
  const auto curlew = daemon({"--config", config, "--camera", "aravis:127.0.0.1", "--sensor",
                              scratch_ / "sensor.fits", "--jsonl", scratch_ / "live.jsonl"});
  const auto status = [&] { return json::parse(ask_daemon(socket, "status")); };
  const auto results = [&] { return status()["results"].get<std::int64_t>(); };
  const auto goes_on = [&] {
    const std::int64_t enough = results() + kDistinctFrames;
    for (int i = 0; i < 1000 && results() < enough; ++i)
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    return results() >= enough;
  };
  const auto lose = [&](const std::unique_ptr<Process>& server) {
    server->signal(SIGKILL);
    server->wait(seconds(5));
    const auto streams = [&] {
      const std::string state = status()["state"].get<std::string>();
      return state == "streaming" || state == "degraded" || state == "no light";
    };
    for (int i = 0; i < 500 && streams(); ++i)
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    return results();
  };
  ASSERT_TRUE(curlew->says("state=searching", seconds(20))) << curlew->err();
  std::int64_t before = 0;
  {
    const auto server = serve({"--rate", "200"});
    ASSERT_TRUE(goes_on()) << curlew->err();
    before = lose(server);
  }
  {
    const auto server = serve({"--rate", "200"}, "smaller.fits");
    EXPECT_TRUE(curlew->says("is 88×96 but", seconds(20))) << curlew->err();
    std::this_thread::sleep_for(seconds(1));  // in which it tries again
    EXPECT_EQ(results(), before);
    EXPECT_EQ(lose(server), before);
  }
  {
    const auto server = serve({"--rate", "200"}, "bytes.fits");
    EXPECT_TRUE(curlew->says("pixel format is 8 bits but", seconds(20))) << curlew->err();
    EXPECT_EQ(lose(server), before);
  }
  const auto server = serve({"--rate", "200"});
  EXPECT_TRUE(goes_on()) << curlew->err();
  curlew->signal(SIGTERM);
  ASSERT_EQ(curlew->wait(seconds(30)), 0) << curlew->err();
  const std::string log = curlew->err();
  int told = 0;
  for (std::size_t at = log.find("88×96"); at != std::string::npos; at = log.find("88×96", at + 1))
    ++told;
  EXPECT_LE(told, 2) << "it is said again only after another complaint\n" << log;
  expect_balanced(Account(curlew->out()));
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

TEST_F(Daemon, WithoutAFrameNothingWasMeasured) {
  make_sensor_and_recording();
  const auto curlew = daemon(
      {"--camera", "aravis:127.0.0.1", "--sensor", scratch_ / "sensor.fits", "--seconds", "0.5"});
  EXPECT_EQ(curlew->wait(seconds(30)), 1) << curlew->err();
  EXPECT_NE(curlew->err().find("nothing was measured: no frame came from aravis:127.0.0.1"),
            std::string::npos)
      << curlew->err();
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
