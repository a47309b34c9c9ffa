#include "service/metrics/metrics_server.h"

#include <arpa/inet.h>
#include <netdb.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <memory>
#include <system_error>
#include <vector>

#include "core/error.h"

namespace curlew {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::size_t kMostClients = 16;
constexpr std::size_t kLongestRequest = 4096;
constexpr auto kLongestVisit = std::chrono::seconds(5);
constexpr auto kTextAge = std::chrono::milliseconds(100);
constexpr int kTickMs = 100;

using Addresses = std::unique_ptr<addrinfo, decltype(&freeaddrinfo)>;

Addresses addresses_of(const std::string& listen) {
  const std::size_t colon = listen.rfind(':');
  std::string host = colon == std::string::npos ? "" : listen.substr(0, colon);
  if (host == "localhost") host = "127.0.0.1";
  if (host.size() > 2 && host.front() == '[' && host.back() == ']')
    host = host.substr(1, host.size() - 2);
  addrinfo hints{};
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = AI_NUMERICHOST | AI_NUMERICSERV;
  addrinfo* found = nullptr;
  if (host.empty() || colon + 1 == listen.size() ||
      getaddrinfo(host.c_str(), listen.c_str() + colon + 1, &hints, &found) != 0)
    throw UsageError("metrics.listen '" + listen +
                     "' is no numeric address and port, as 127.0.0.1:9464 or [::1]:9464");
  return {found, freeaddrinfo};
}

bool is_loopback(const sockaddr* address) {
  if (address->sa_family == AF_INET6)
    return IN6_IS_ADDR_LOOPBACK(&reinterpret_cast<const sockaddr_in6*>(address)->sin6_addr) != 0;
  const auto* v4 = reinterpret_cast<const sockaddr_in*>(address);
  return ntohl(v4->sin_addr.s_addr) >> 24U == IN_LOOPBACKNET;
}

int listen_at(const MetricsOptions& options) {
  const Addresses address = addresses_of(options.listen);
  if (!options.beyond_loopback && !is_loopback(address->ai_addr))
    throw UsageError("metrics.listen " + options.listen +
                     " lies beyond loopback; set beyond_loopback = true if other machines may ask");
  const int listening = socket(address->ai_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  const int yes = 1;
  setsockopt(listening, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof(yes));
  if (bind(listening, address->ai_addr, address->ai_addrlen) == 0 &&
      ::listen(listening, kMostClients) == 0)
    return listening;
  const std::string why = std::generic_category().message(errno);
  if (listening >= 0) close(listening);
  throw Failure("metrics: " + options.listen + " cannot be listened on: " + why +
                "; set another listen in section [metrics]");
}

int port_of(int listening) {
  sockaddr_storage address{};
  socklen_t length = sizeof(address);
  getsockname(listening, reinterpret_cast<sockaddr*>(&address), &length);
  // The port has the same place in both families.
  return ntohs(reinterpret_cast<const sockaddr_in*>(&address)->sin_port);
}

std::string response(const char* status, const std::string& body, bool with_body = true) {
  return std::string("HTTP/1.1 ") + status +
         "\r\nContent-Type: text/plain; version=0.0.4; charset=utf-8\r\nContent-Length: " +
         std::to_string(body.size()) + "\r\nConnection: close\r\n\r\n" + (with_body ? body : "");
}

std::string answer_to(const std::string& request, const std::function<std::string()>& text) {
  const std::string line = request.substr(0, request.find("\r\n"));
  const std::size_t first = line.find(' ');
  const std::size_t second = line.find(' ', first + 1);
  if (first == std::string::npos || second == std::string::npos ||
      line.compare(second + 1, 5, "HTTP/") != 0)
    return response("400 Bad Request", "this is no HTTP\n");
  const std::string method = line.substr(0, first);
  const std::string path = line.substr(first + 1, second - first - 1);
  if (method != "GET" && method != "HEAD")
    return response("405 Method Not Allowed", "only GET is answered\n");
  if (path != "/metrics" && path.rfind("/metrics?", 0) != 0)
    return response("404 Not Found", "the metrics are at /metrics\n");
  return response("200 OK", text(), method == "GET");
}

/// One connection: first a request comes in, then the answer goes out.
class Client {
 public:
  explicit Client(int socket) : socket_(socket) {}
  ~Client() { close(socket_); }
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  pollfd waits_for() const {
    return {socket_, static_cast<short>(answer_.empty() ? POLLIN : POLLOUT), 0};
  }
  bool expired() const { return Clock::now() - since_ > kLongestVisit; }

  /// Goes on without waiting. Returns false when it is over.
  bool go_on(const std::function<std::string()>& text) {
    return answer_.empty() ? receive(text) : send_more();
  }

 private:
  bool receive(const std::function<std::string()>& text) {
    char block[1024];
    const ssize_t n = recv(socket_, block, sizeof(block), 0);
    if (n < 0) return errno == EAGAIN || errno == EINTR;
    if (n == 0) return false;
    request_.append(block, static_cast<std::size_t>(n));
    if (request_.find("\r\n\r\n") != std::string::npos) {
      answer_ = answer_to(request_, text);
    } else if (request_.size() > kLongestRequest) {
      answer_ = response("431 Request Header Fields Too Large", "the request is too long\n");
    }
    return answer_.empty() || send_more();
  }
  bool send_more() {
    const ssize_t n = send(socket_, answer_.data() + sent_, answer_.size() - sent_, MSG_NOSIGNAL);
    if (n < 0) return errno == EAGAIN || errno == EINTR;
    sent_ += static_cast<std::size_t>(n);
    if (sent_ < answer_.size()) return true;
    shutdown(socket_, SHUT_WR);
    return false;
  }

  int socket_;
  Clock::time_point since_ = Clock::now();
  std::string request_;
  std::string answer_;
  std::size_t sent_ = 0;
};

}  // namespace

MetricsServer::MetricsServer(const MetricsOptions& options, std::function<std::string()> text)
    : text_(std::move(text)),
      listening_(listen_at(options)),
      port_(port_of(listening_)),
      thread_([this] { serve(); }) {}

MetricsServer::~MetricsServer() {
  stopping_ = true;
  thread_.join();
  close(listening_);
}

void MetricsServer::serve() {
  std::vector<std::unique_ptr<Client>> clients;  // the oldest first
  std::string text;
  Clock::time_point made{};
  const auto fresh_text = [&] {
    if (text.empty() || Clock::now() - made > kTextAge) {
      text = text_();
      made = Clock::now();
    }
    return text;
  };
  while (!stopping_) {
    std::vector<pollfd> polled{{listening_, POLLIN, 0}};
    for (const auto& client : clients) polled.push_back(client->waits_for());
    if (poll(polled.data(), polled.size(), kTickMs) < 0) {
      // Nothing is known of any client then, so the next round asks again.
      if (errno != EINTR) std::this_thread::sleep_for(std::chrono::milliseconds(kTickMs));
      continue;
    }
    std::vector<std::unique_ptr<Client>> staying;
    for (std::size_t i = 0; i < clients.size(); ++i) {
      const bool goes_on = polled[i + 1].revents == 0 || clients[i]->go_on(fresh_text);
      if (goes_on && !clients[i]->expired()) staying.push_back(std::move(clients[i]));
    }
    clients = std::move(staying);
    const int accepted = polled[0].revents != 0
                             ? accept4(listening_, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC)
                             : -1;
    if (accepted < 0) {
      // Where the process may open no more files, the client goes on waiting, and so do we.
      if (polled[0].revents != 0) std::this_thread::sleep_for(std::chrono::milliseconds(10));
      continue;
    }
    if (clients.size() == kMostClients) clients.erase(clients.begin());
    clients.push_back(std::make_unique<Client>(accepted));
  }
}

}  // namespace curlew
