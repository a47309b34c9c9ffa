// What a service manager hears; a socket of this test takes its place.
#include "service/daemon/notify.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstdlib>
#include <cstring>
#include <thread>

#include "tests/support/scratch_directory.h"

namespace curlew {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::MatchesRegex;

/// A service manager's end: a datagram socket, and the environment in which a service is started.
class FakeManager {
 public:
  explicit FakeManager(const char* watchdog_us = nullptr) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    const std::string path = scratch_ / "notify";
    std::strncpy(address.sun_path, path.c_str(), sizeof address.sun_path - 1);
    socket_ = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    usable_ = bind(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
    setenv("NOTIFY_SOCKET", path.c_str(), 1);
    if (watchdog_us == nullptr) return;
    setenv("WATCHDOG_USEC", watchdog_us, 1);
    setenv("WATCHDOG_PID", std::to_string(getpid()).c_str(), 1);
  }
  ~FakeManager() {
    for (const char* name : {"NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"}) unsetenv(name);
    close(socket_);
  }
  FakeManager(const FakeManager&) = delete;
  FakeManager& operator=(const FakeManager&) = delete;

  bool usable() const { return usable_; }
  /// Returns all messages that came since the last call.
  std::vector<std::string> heard() {
    std::vector<std::string> messages;
    char buffer[4096];
    for (ssize_t got = 0; (got = recv(socket_, buffer, sizeof buffer, 0)) > 0;)
      messages.emplace_back(buffer, static_cast<std::size_t>(got));
    return messages;
  }

 private:
  ScratchDirectory scratch_;
  int socket_ = -1;
  bool usable_ = false;
};

TEST(Supervisor, HearsTheLifeOfAService) {
  FakeManager manager;
  ASSERT_TRUE(manager.usable());
  Supervisor supervisor;
  EXPECT_TRUE(supervisor.listens());
  EXPECT_THAT(manager.heard(), IsEmpty()) << "it must say nothing before it is ready";
  supervisor.ready("streaming");
  supervisor.status("1000.2 frames/s");
  supervisor.reloading();
  supervisor.ready("streaming");
  supervisor.stopping();
  EXPECT_THAT(manager.heard(), ElementsAre("READY=1\nSTATUS=streaming", "STATUS=1000.2 frames/s",
                                           MatchesRegex("RELOADING=1\nMONOTONIC_USEC=[0-9]+"),
                                           "READY=1\nSTATUS=streaming", "STOPPING=1"));
}

TEST(Supervisor, AStatusIsOneLineAndCannotSayMore) {
  FakeManager manager;
  ASSERT_TRUE(manager.usable());
  Supervisor supervisor;
  supervisor.status("lost\nSTOPPING=1");
  EXPECT_THAT(manager.heard(), ElementsAre("STATUS=lost STOPPING=1"));
}

TEST(Supervisor, WithoutAManagerNothingHappens) {
  ASSERT_EQ(std::getenv("NOTIFY_SOCKET"), nullptr);
  Supervisor supervisor;
  EXPECT_FALSE(supervisor.listens());
  EXPECT_EQ(supervisor.watchdog_period().count(), 0);
  supervisor.ready("");
  supervisor.status("");
  supervisor.reloading();
  supervisor.watchdog();
  supervisor.stopping();
}

TEST(Supervisor, AManagerThatIsGoneDoesNotMatter) {
  setenv("NOTIFY_SOCKET", "/nonexistent/notify", 1);
  Supervisor supervisor;
  supervisor.ready("streaming");
  supervisor.watchdog();
  supervisor.stopping();
  unsetenv("NOTIFY_SOCKET");
}

TEST(Supervisor, TheWatchdogIsNotFedWhereNobodyWatches) {
  FakeManager manager;
  ASSERT_TRUE(manager.usable());
  Supervisor supervisor;
  for (int i = 0; i < 100; ++i) supervisor.watchdog();
  EXPECT_THAT(manager.heard(), IsEmpty());
}

TEST(Supervisor, TheWatchdogIsFedOncePerHalfPeriod) {
  FakeManager manager("3600000000");  // an hour, so that the second message is never due
  ASSERT_TRUE(manager.usable());
  Supervisor supervisor;
  EXPECT_EQ(supervisor.watchdog_period(), std::chrono::hours(1));
  for (int i = 0; i < 1000; ++i) supervisor.watchdog();
  EXPECT_THAT(manager.heard(), ElementsAre("WATCHDOG=1"));
}

TEST(Supervisor, TheWatchdogIsFedAgainAndAgain) {
  constexpr std::chrono::milliseconds kPeriod(20);
  FakeManager manager("20000");
  ASSERT_TRUE(manager.usable());
  Supervisor supervisor;
  const auto begin = std::chrono::steady_clock::now();
  std::size_t words = 0;
  while (words < 5) {
    supervisor.watchdog();
    const auto heard = manager.heard();
    EXPECT_LE(heard.size(), 1U);
    words += heard.size();
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  // Five messages have four half periods between them, however slow the machine is.
  EXPECT_GE(std::chrono::steady_clock::now() - begin, 4 * kPeriod / 2);
}

TEST(Supervisor, AWatchdogForAnotherProcessIsNotOurs) {
  FakeManager manager("1000");
  ASSERT_TRUE(manager.usable());
  setenv("WATCHDOG_PID", std::to_string(getppid()).c_str(), 1);
  Supervisor supervisor;
  supervisor.watchdog();
  EXPECT_EQ(supervisor.watchdog_period().count(), 0);
  EXPECT_THAT(manager.heard(), IsEmpty());
}

}  // namespace
}  // namespace curlew
