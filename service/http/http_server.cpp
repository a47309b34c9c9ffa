#include "service/http/http_server.h"

#include <arpa/inet.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <system_error>
#include <vector>

#include "core/error.h"

namespace curlew {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr std::size_t kMostClients = 32;
constexpr int kLetInAtOnce = 8;  // fewer than kMostClients, so that each of them is looked at
constexpr int kQueue = 128;      // of connections that the kernel has made and nobody let in yet
constexpr auto kLongestVisit = std::chrono::seconds(5);
constexpr int kTickMs = 100;
constexpr int kWaitingTickMs = 5;

using Addresses = std::unique_ptr<addrinfo, decltype(&freeaddrinfo)>;

Addresses addresses_of(const HttpAddress& address) {
  const std::string& listen = address.listen;
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
    throw UsageError(address.section + ".listen '" + listen +
                     "' is no numeric address and port, as 127.0.0.1:9464 or [::1]:9464");
  return {found, freeaddrinfo};
}

bool is_loopback(const sockaddr* address) {
  if (address->sa_family == AF_INET6)
    return IN6_IS_ADDR_LOOPBACK(&reinterpret_cast<const sockaddr_in6*>(address)->sin6_addr) != 0;
  const auto* v4 = reinterpret_cast<const sockaddr_in*>(address);
  return ntohl(v4->sin_addr.s_addr) >> 24U == IN_LOOPBACKNET;
}

int listen_at(const HttpAddress& wanted) {
  const Addresses address = addresses_of(wanted);
  if (!wanted.beyond_loopback && !is_loopback(address->ai_addr))
    throw UsageError(wanted.section + ".listen " + wanted.listen + " lies beyond loopback; " +
                     wanted.remedy + " if other machines may ask");
  const int listening = socket(address->ai_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  const int yes = 1;
  setsockopt(listening, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof(yes));
  if (bind(listening, address->ai_addr, address->ai_addrlen) == 0 &&
      ::listen(listening, kQueue) == 0)
    return listening;
  const std::string why = std::generic_category().message(errno);
  if (listening >= 0) close(listening);
  throw Failure(wanted.section + ": " + wanted.listen + " cannot be listened on: " + why +
                "; set another listen in section [" + wanted.section + "]");
}

int port_of(int listening) {
  sockaddr_storage address{};
  socklen_t length = sizeof(address);
  getsockname(listening, reinterpret_cast<sockaddr*>(&address), &length);
  // The port has the same place in both families.
  return ntohs(reinterpret_cast<const sockaddr_in*>(&address)->sin_port);
}

const char* reason_of(int status) {
  switch (status) {
    case 200:
      return "OK";
    case 400:
      return "Bad Request";
    case 403:
      return "Forbidden";
    case 404:
      return "Not Found";
    case 405:
      return "Method Not Allowed";
    case 431:
      return "Request Too Large";
    default:
      return "Error";
  }
}

std::string peer_of(int socket) {
  sockaddr_storage address{};
  socklen_t length = sizeof(address);
  auto* peer = reinterpret_cast<sockaddr*>(&address);
  char host[64];
  char port[16];
  if (getpeername(socket, peer, &length) != 0 ||
      getnameinfo(peer, length, host, sizeof(host), port, sizeof(port),
                  NI_NUMERICHOST | NI_NUMERICSERV) != 0)
    return "somebody who is gone";
  return std::string(host) + " port " + port;
}

/// One connection: a request comes in, waits for its answer, and the answer goes out.
class Client {
 public:
  explicit Client(int socket) : socket_(socket) {
    const int yes = 1;
    setsockopt(socket_, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof(yes));
  }
  ~Client() { close(socket_); }
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  bool waits_for_answer() const { return request_.has_value(); }
  pollfd waits_for() const {
    if (request_) return {socket_, 0, 0};  // The kernel still tells that the peer is gone.
    return {socket_, static_cast<short>(head_.empty() ? POLLIN : POLLOUT), 0};
  }
  /// Since when the client has been receiving, waiting or sending.
  Clock::time_point since() const { return since_; }
  bool expired() const { return !request_ && Clock::now() - since_ > kLongestVisit; }

  /// Goes on without waiting. Returns false when it is over. revents: of poll().
  bool go_on(short revents, const HttpHandler& handler) {
    if (request_) return (revents & (POLLERR | POLLHUP)) == 0 && try_to_answer(handler);
    if (revents == 0) return true;
    return head_.empty() ? receive(handler) : send_more();
  }

 private:
  bool receive(const HttpHandler& handler) {
    char block[4096];
    const ssize_t n = recv(socket_, block, sizeof(block), 0);
    if (n < 0) return errno == EAGAIN || errno == EINTR;
    if (n == 0) return false;
    received_.append(block, static_cast<std::size_t>(n));
    return parse(handler);
  }
  bool parse(const HttpHandler& handler) {
    ParsedRequest parsed = parse_request(received_);
    if (parsed.state == HttpParse::kIncomplete) return true;
    const auto quiet = Clock::now() - answered_;
    since_ = Clock::now();
    if (parsed.state == HttpParse::kBad) return answer(plain_answer(400, "this is no HTTP\n"));
    if (parsed.state == HttpParse::kTooLong)
      return answer(plain_answer(431, "the request is too long\n"));
    received_.erase(0, parsed.used);
    request_ = std::move(parsed.request);
    request_->peer = peer_of(socket_);
    request_->since_answer = std::chrono::duration_cast<milliseconds>(quiet);
    return try_to_answer(handler);
  }
  bool try_to_answer(const HttpHandler& handler) {
    const auto waited = std::chrono::duration_cast<milliseconds>(Clock::now() - since_);
    if (const auto made = handler(*request_, waited)) return answer(*made);
    return true;
  }
  bool answer(const HttpAnswer& made) {
    // HTTP/1.0 is told "close" as well, which is what it expects.
    keep_open_ = made.keep_open && request_ && request_->header("connection") != "close" &&
                 received_.empty();
    const bool only_head = request_ && request_->method == "HEAD";
    const std::size_t length = made.body ? made.body->size() : 0;
    head_ = "HTTP/1.1 " + std::to_string(made.status) + " " + reason_of(made.status) +
            "\r\nContent-Type: " + made.content_type +
            "\r\nContent-Length: " + std::to_string(length) + "\r\n" + made.headers +
            "Connection: " + (keep_open_ ? "keep-alive" : "close") + "\r\n\r\n";
    body_ = only_head ? nullptr : made.body;
    sent_ = 0;
    request_.reset();
    since_ = answered_ = Clock::now();
    return send_more();
  }
  bool send_more() {
    const std::size_t length = head_.size() + (body_ ? body_->size() : 0);
    while (sent_ < length) {
      const bool in_head = sent_ < head_.size();
      const std::string& part = in_head ? head_ : *body_;
      const std::size_t from = in_head ? sent_ : sent_ - head_.size();
      const ssize_t n = send(socket_, part.data() + from, part.size() - from, MSG_NOSIGNAL);
      if (n < 0) return errno == EAGAIN || errno == EINTR;
      sent_ += static_cast<std::size_t>(n);
      since_ = Clock::now();  // Who takes its answer piece by piece may go on.
    }
    head_.clear();
    body_.reset();
    if (!keep_open_) shutdown(socket_, SHUT_WR);
    return keep_open_;
  }

  int socket_;
  Clock::time_point since_ = Clock::now();
  Clock::time_point answered_ = since_;  ///< when the last answer was made, or the client came
  std::string received_;
  std::optional<HttpRequest> request_;  ///< while its answer is not made
  std::string head_;                    ///< of the answer; empty while none goes out
  std::shared_ptr<const std::string> body_;
  std::size_t sent_ = 0;
  bool keep_open_ = false;
};

using Clients = std::vector<std::unique_ptr<Client>>;

void let_in(int listening, Clients& clients) {
  for (int i = 0; i < kLetInAtOnce; ++i) {
    const int accepted = accept4(listening, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
    if (accepted < 0 && errno == EAGAIN) return;
    if (accepted < 0) {
      // Where the process may open no more files, the client goes on waiting, and so do we.
      std::this_thread::sleep_for(milliseconds(10));
      return;
    }
    if (clients.size() == kMostClients)
      clients.erase(
          std::ranges::min_element(clients, {}, [](const auto& c) { return c->since(); }));
    clients.push_back(std::make_unique<Client>(accepted));
  }
}

}  // namespace

HttpAnswer plain_answer(int status, std::string text) {
  HttpAnswer answer;
  answer.status = status;
  answer.body = std::make_shared<const std::string>(std::move(text));
  return answer;
}

HttpServer::HttpServer(const HttpAddress& address, HttpHandler handler)
    : handler_(std::move(handler)),
      listening_(listen_at(address)),
      port_(port_of(listening_)),
      thread_([this] { serve(); }) {}

HttpServer::~HttpServer() {
  stopping_ = true;
  thread_.join();
  close(listening_);
}

void HttpServer::serve() const {
  Clients clients;
  while (!stopping_) {
    std::vector<pollfd> polled{{listening_, POLLIN, 0}};
    int tick_ms = kTickMs;
    for (const auto& client : clients) {
      polled.push_back(client->waits_for());
      if (client->waits_for_answer()) tick_ms = kWaitingTickMs;
    }
    if (poll(polled.data(), polled.size(), tick_ms) < 0) {
      // Nothing is known of any client then, so the next round asks again.
      if (errno != EINTR) std::this_thread::sleep_for(milliseconds(kTickMs));
      continue;
    }
    Clients staying;
    for (std::size_t i = 0; i < clients.size(); ++i)
      if (clients[i]->go_on(polled[i + 1].revents, handler_) && !clients[i]->expired())
        staying.push_back(std::move(clients[i]));
    clients = std::move(staying);
    if (polled[0].revents != 0) let_in(listening_, clients);
  }
}

}  // namespace curlew
