// Who may see the page and who may change what; and nobody holds it up.
#include "service/page/page_server.h"

#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <vector>

#include "core/error.h"
#include "tests/support/http.h"
#include "tests/support/scratch_directory.h"

namespace curlew {
namespace {

/// A replay of one frame, which is no more than a name.
class OneFrame final : public PageSource {
 public:
  std::string status() override { return "{}"; }
  PageMessage sensor(std::int64_t) override { return nullptr; }
  PageMessage frame(std::int64_t number, std::chrono::milliseconds) override {
    return number == 0 ? plain_message(R"({"kind":"frame"})") : nullptr;
  }
  std::chrono::milliseconds between_frames() const override { return pause; }

  std::chrono::milliseconds pause{0};
};

const char* const kToken = "0123456789abcdef0123456789abcdef";

PageOptions at(const std::string& listen) {
  PageOptions options;
  options.listen = listen;
  return options;
}

class PageServerTest : public ::testing::Test {
 protected:
  std::string ask(const PageServer& server, const std::string& line,
                  const std::string& headers = "Host: localhost\r\n",
                  const std::string& body = "") const {
    const std::string& url = server.url();
    const int port = std::stoi(url.substr(url.rfind(':') + 1));
    const std::string length = "Content-Length: " + std::to_string(body.size()) + "\r\n";
    return ask_http(port,
                    line + " HTTP/1.1\r\nConnection: close\r\n" + headers + length + "\r\n" + body);
  }
  static std::string status_of(const std::string& answer) { return answer.substr(9, 3); }

  OneFrame source_;
  PageServer server_{at("127.0.0.1:0"), source_};
};

TEST_F(PageServerTest, ServesItsFilesAndFramesAndNothingElse) {
  for (const char* path : {"/", "/page.js", "/page.css", "/icon.svg", "/message.js"}) {
    const std::string answer = ask(server_, std::string("GET ") + path);
    EXPECT_EQ(status_of(answer), "200") << path;
    EXPECT_NE(answer.find("Content-Security-Policy: default-src 'none'; script-src 'self'"),
              std::string::npos);
  }
  EXPECT_NE(ask(server_, "GET /frame?number=0").find(R"({"kind":"frame","arrays":[]})"),
            std::string::npos);
  EXPECT_EQ(status_of(ask(server_, "GET /frame?number=1")), "404") << "after two seconds";
  for (const char* path : {"/frame", "/frame?number=x", "/frame?number=", "/sensor?number=1e3"})
    EXPECT_EQ(status_of(ask(server_, std::string("GET ") + path)), "400") << path;
  for (const char* path : {"/../page.js", "/etc/passwd", "/sensor?number=9", "/page.js/"})
    EXPECT_EQ(status_of(ask(server_, std::string("GET ") + path)), "404") << path;
  EXPECT_EQ(status_of(ask(server_, "DELETE /")), "405");
}

TEST_F(PageServerTest, AStrangersNameForThisMachineIsRefused) {
  for (const char* host : {"localhost:8080", "127.0.0.1", "127.1.2.3:1", "[::1]:8080"})
    EXPECT_EQ(status_of(ask(server_, "GET /", std::string("Host: ") + host + "\r\n")), "200")
        << host;
  for (const char* host : {"evil.example", "127.evil.example", "localhost.evil.example", "10.0.0.1",
                           "", "[::1].evil.example"})
    EXPECT_EQ(status_of(ask(server_, "GET /", std::string("Host: ") + host + "\r\n")), "403")
        << host;
}

TEST_F(PageServerTest, BeyondLoopbackItTakesATokenFromAFile) {
  const ScratchDirectory scratch;
  const auto refusal = [&](const PageOptions& options) {
    try {
      const PageServer open(options, source_);
    } catch (const UsageError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_NE(refusal(at("0.0.0.0:0")).find("lies beyond loopback; set token_file"),
            std::string::npos);
  PageOptions options = at("0.0.0.0:0");
  options.token_file = scratch / "token";
  for (const char* weak :
       {"", "short", "spaces in it are no good at all", "0123456789abcde\xc3\xa9"}) {
    write_bytes(options.token_file, weak);
    EXPECT_NE(refusal(options).find("must hold at least 16 letters and digits"), std::string::npos)
        << weak;
  }
  write_bytes(scratch / "token", std::string(kToken) + "\n");
  const PageServer guarded(options, source_);
  const std::string host = "Host: laboratory.example\r\n";
  EXPECT_EQ(guarded.url().find(kToken), std::string::npos) << "it goes into logs";
  const std::string port = guarded.url().substr(0, guarded.url().find("/?"));
  const auto guarded_ask = [&](const std::string& path, const std::string& headers) {
    return ask_http(std::stoi(port.substr(port.rfind(':') + 1)),
                    "GET " + path + " HTTP/1.1\r\nConnection: close\r\n" + headers + "\r\n");
  };
  EXPECT_EQ(status_of(guarded_ask("/", host)), "403");
  EXPECT_EQ(status_of(guarded_ask("/?token=0123456789abcdef0123456789abcdeX", host)), "403");
  EXPECT_EQ(status_of(guarded_ask(std::string("/frame?number=0&token=") + kToken, host)), "403");
  const std::string welcome = guarded_ask(std::string("/?token=") + kToken, host);
  EXPECT_EQ(status_of(welcome), "200");
  EXPECT_NE(welcome.find("; HttpOnly; SameSite=Strict;"), std::string::npos);
  const std::string cookie = host + "Cookie: a=b; curlew=" + kToken + "; c=d\r\n";
  EXPECT_EQ(status_of(guarded_ask("/frame?number=0", cookie)), "200");
  EXPECT_EQ(status_of(guarded_ask("/frame?number=0", host + "Cookie: xcurlew=" + kToken + "\r\n")),
            "403");
}

TEST_F(PageServerTest, ChangesAreForThePageItselfWhereItHasTheRight) {
  const std::string own = "Host: localhost\r\nOrigin: http://localhost\r\n";
  EXPECT_NE(ask(server_, "POST /control", own, "{}").find("set control = true"), std::string::npos);
  std::vector<std::string> changes;
  const PageServer may(at("127.0.0.1:0"), source_,
                       [&](const std::string& body, const std::string& peer) {
                         EXPECT_EQ(peer.rfind("127.0.0.1 port ", 0), 0U) << peer;
                         changes.push_back(body);
                         return std::string(body == "{}" ? "" : "this is no change");
                       });
  EXPECT_EQ(status_of(ask(may, "POST /control", own, "{}")), "200");
  EXPECT_EQ(status_of(ask(may, "POST /control", own, "x")), "400");
  EXPECT_EQ(changes.size(), 2U);
  for (const char* stranger : {"", "Origin: http://evil.example\r\n", "Origin: null\r\n",
                               "Origin: http://localhost:8080\r\n",
                               "Origin: http://localhost\r\nSec-Fetch-Site: cross-site\r\n"})
    EXPECT_EQ(
        status_of(ask(may, "POST /control", std::string("Host: localhost\r\n") + stranger, "{}")),
        "403")
        << stranger;
  EXPECT_EQ(changes.size(), 2U);
}

TEST_F(PageServerTest, WhoAsksForOneFrameOverAndOverGetsItAtThePaceOfFrames) {
  OneFrame source;
  source.pause = std::chrono::milliseconds(50);
  const PageServer server(at("127.0.0.1:0"), source);
  const int port = std::stoi(server.url().substr(server.url().rfind(':') + 1));
  const auto begin = std::chrono::steady_clock::now();
  const LocalConnection kept(port);
  for (int i = 0; i < 6; ++i) {
    kept.send("GET /frame?number=0 HTTP/1.1\r\nHost: localhost\r\n\r\n");
    ASSERT_EQ(status_of(kept.receive("}")), "200");
  }
  for (int i = 0; i < 6; ++i) ASSERT_EQ(status_of(ask(server, "GET /frame?number=0")), "200");
  EXPECT_GE(std::chrono::steady_clock::now() - begin, 12 * source.pause);
}

TEST_F(PageServerTest, ThousandSilentAndEndlessClientsHoldNobodyUp) {
  const int port = std::stoi(server_.url().substr(server_.url().rfind(':') + 1));
  std::vector<std::unique_ptr<LocalConnection>> idle;
  for (int i = 0; i < 1000; ++i) {
    idle.push_back(std::make_unique<LocalConnection>(port));
    idle.back()->send(
        i % 3 == 0 ? ""
                   : (i % 3 == 1 ? "GET /fra"
                                 : "GET /frame?number=7 HTTP/1.1\r\nHost: localhost\r\n\r\n"));
    if (idle.size() > 200) idle.erase(idle.begin());
    if (i % 100 != 99) continue;
    ASSERT_EQ(status_of(ask(server_, "GET /frame?number=0")), "200") << i;
  }
}

}  // namespace
}  // namespace curlew
