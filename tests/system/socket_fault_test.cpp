// Each call on a socket fails once in a daemon that runs: whoever asks next is answered, frames
// come, and nothing is lost without being counted.
#include <gtest/gtest.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <thread>

#include "service/daemon/control_socket.h"
#include "tests/support/failing_calls.h"
#include "tests/support/http.h"
#include "tests/support/paths.h"
#include "tests/system/daemon_fixture.h"

namespace curlew {
namespace {

using std::chrono::seconds;

struct SocketFault {
  const char* call;
  int error;  ///< 0: half of the bytes are taken
};

class SocketFaults : public Daemon {
 protected:
  /// Starts the daemon, whose at-th call of this kind fails, and then every so many-th, if any.
  std::unique_ptr<Process> failing_daemon(const SocketFault& fault, int at,
                                          const std::string& arguments, int every = 0) {
    for (const std::string& of_before : {mark_, scratch_ / "daemon.out", scratch_ / "daemon.err"})
      std::filesystem::remove(of_before);
    const std::string line = "exec env " + failing_call(fault.call, fault.error, at, "", mark_) +
                             "CURLEW_FAIL_EVERY=" + std::to_string(every) + " '" + kCurlewProgram +
                             "' run " + arguments;
    return std::make_unique<Process>(std::vector<std::string>{"/bin/sh", "-c", line},
                                     scratch_ / "daemon.out", scratch_ / "daemon.err");
  }
  bool failed() const { return std::filesystem::exists(mark_); }

  const std::string mark_ = scratch_ / "mark";
};

bool is_answered(const std::string& socket) {
  try {
    return nlohmann::json::accept(ask_daemon(socket, "status"));
  } catch (const std::exception&) {
    return false;
  }
}

bool is_measured(const Process& curlew) {
  const std::string log = curlew.err();
  const std::string words = "answered at port ";
  const int port = std::atoi(log.c_str() + log.find(words) + words.size());
  return ask_http(port, "GET /metrics HTTP/1.1\r\nHost: a\r\n\r\n").find("200 OK") !=
         std::string::npos;
}

TEST_F(SocketFaults, WhoeverAsksNextIsAnswered) {
  const std::string socket = scratch_ / "control";
  write_bytes(scratch_ / "c.toml",
              "[camera]\nsource = \"sim:vortex\"\nframe_rate_hz = 200\n[daemon]\ncontrol = \"" +
                  socket + "\"\n[metrics]\nlisten = \"127.0.0.1:0\"\n");
  for (const SocketFault& fault :
       {SocketFault{"accept4", EMFILE}, SocketFault{"recv", EINTR}, SocketFault{"recv", ECONNRESET},
        SocketFault{"send", EINTR}, SocketFault{"send", EPIPE}, SocketFault{"send", 0},
        SocketFault{"poll", EINTR}, SocketFault{"poll", ENOMEM}}) {
    for (const int at : {1, 2}) {  // The control socket has the first, the metrics the second.
      SCOPED_TRACE(std::string(fault.call) + " " + std::to_string(at) + ", error " +
                   std::to_string(fault.error));
      const auto curlew = failing_daemon(fault, at, "--config " + (scratch_ / "c.toml"));
      ASSERT_TRUE(curlew->says("state=streaming", seconds(30))) << curlew->err();
      int answers = 0;
      for (int round = 0; round < 2; ++round) {
        answers += is_answered(socket) ? 1 : 0;
        answers += is_measured(*curlew) ? 1 : 0;
      }
      const bool harmless = fault.error == EINTR || fault.error == 0 || fault.error == EMFILE ||
                            fault.error == ENOMEM;
      EXPECT_GE(answers, harmless ? 4 : 3);
      EXPECT_TRUE(failed()) << "it was never called";
      curlew->signal(SIGTERM);
      ASSERT_EQ(curlew->wait(seconds(30)), 0) << curlew->err();
      expect_balanced(Account(curlew->out()));
      EXPECT_FALSE(std::filesystem::exists(socket));
    }
  }
}

/// The calls by which a network camera is found, opened, heard and let go. GLib makes them as send,
/// sendmsg, recv and recvmsg; it never calls sendto and recvfrom.
constexpr SocketFault kOfNetworkCameras[] = {
    {"socket", EMFILE},       {"socket", ENOBUFS}, {"bind", EADDRINUSE}, {"setsockopt", EPERM},
    {"connect", ENETUNREACH}, {"send", EINTR},     {"send", ENOBUFS},    {"sendmsg", EINTR},
    {"sendmsg", ENOBUFS},     {"recv", EINTR},     {"recv", ENOMEM},     {"recvmsg", EINTR},
    {"poll", EINTR},          {"poll", ENOMEM}};

// CURLEW_SOCKET_FAULTS=60 has every one of the first 60 calls fail, which takes minutes.
TEST_F(SocketFaults, ANetworkCameraIsFoundAllTheSame) {
  const char* asked = std::getenv("CURLEW_SOCKET_FAULTS");
  const int most = asked == nullptr ? 1 : std::atoi(asked);
  make_sensor_and_recording();
  write_bytes(scratch_ / "c.toml", "[camera]\nmax_backoff_s = 0.2\n");
  const auto server = serve({"--rate", "300"});
  int faults = 0;
  for (const SocketFault& fault : kOfNetworkCameras) {
    // Aravis does not survive it where this socket, that of the control channel, is refused.
    int fatal = std::string(fault.call) == "socket" || std::string(fault.call) == "bind" ? 1 : 0;
    for (int at = 1; at <= most; ++at) {
      SCOPED_TRACE(std::string(fault.call) + " " + std::to_string(at) + ", error " +
                   std::to_string(fault.error));
      const std::string lines = scratch_ / "live.jsonl";
      std::filesystem::remove(lines);
      const auto curlew = failing_daemon(fault, at,
                                         "--config " + (scratch_ / "c.toml") +
                                             " --camera aravis:127.0.0.1 --frames 20 --sensor " +
                                             (scratch_ / "sensor.fits") + " --jsonl " + lines);
      const int exit_code = curlew->wait(seconds(60));
      if (!failed()) break;
      ++faults;
      if (at > 1 && exit_code == 128 + SIGSEGV && fatal-- > 0) continue;
      ASSERT_EQ(exit_code, 0) << curlew->err();
      const Account account(curlew->out());
      expect_balanced(account);
      EXPECT_EQ(account.results, 20);
      EXPECT_EQ(json_lines(lines).size(), 20U);
    }
  }
  EXPECT_GE(faults, 8) << "most of these are called";
  std::printf("%d faults\n", faults);
}

TEST_F(SocketFaults, ANetworkCameraThatDiesIsFoundAgainWhileCallsFail) {
  make_sensor_and_recording();
  const std::string lines = scratch_ / "live.jsonl";
  write_bytes(scratch_ / "c.toml", "[camera]\ntimeout_s = 0.5\nmax_backoff_s = 0.2\n");
  std::int64_t results = 0;  // of all daemons, which append to the same file
  const auto grown = [&] {
    const auto until = std::chrono::steady_clock::now() + seconds(30);
    const auto size = [&] {
      std::error_code none;
      const auto bytes = std::filesystem::file_size(lines, none);
      return none ? 0 : bytes;
    };
    const auto before = size();
    while (size() == before && std::chrono::steady_clock::now() < until)
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    return size() > before;
  };
  // Frames of this life must not be taken for those of the next.
  const auto wait_for_silence = [&] {
    std::uintmax_t before = 0;
    do {
      before = std::filesystem::file_size(lines);
      std::this_thread::sleep_for(std::chrono::milliseconds(300));
    } while (std::filesystem::file_size(lines) != before);
  };
  for (const SocketFault& fault :
       {SocketFault{"setsockopt", EPERM}, SocketFault{"sendmsg", ENOBUFS},
        SocketFault{"recv", EINTR}, SocketFault{"poll", EINTR}}) {
    SCOPED_TRACE(std::string(fault.call) + ", error " + std::to_string(fault.error));
    constexpr int kEvery = 11;
    const auto curlew = failing_daemon(fault, 1,
                                       "--config " + (scratch_ / "c.toml") +
                                           " --camera aravis:127.0.0.1 --sensor " +
                                           (scratch_ / "sensor.fits") + " --jsonl " + lines,
                                       kEvery);
    for (int life = 0; life < 2; ++life) {
      const auto server = serve({"--rate", "300"});
      ASSERT_TRUE(grown()) << "life " << life << "\n" << curlew->err();
      server->signal(SIGKILL);
      server->wait(seconds(5));
      wait_for_silence();
    }
    EXPECT_TRUE(failed());
    curlew->signal(SIGTERM);
    ASSERT_EQ(curlew->wait(seconds(30)), 0) << curlew->err();
    const Account account(curlew->out());
    expect_balanced(account);
    EXPECT_GE(account.connections, 2);
    results += account.results;
    EXPECT_EQ(results, static_cast<std::int64_t>(json_lines(lines).size()));
  }
  expect_as_replayed(lines);
}

}  // namespace
}  // namespace curlew
