// This asks an HTTP server on this machine, byte by byte as the test wants it.
#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <string>

namespace curlew {

/// Is a TCP connection to a port of 127.0.0.1. Reading ends after ten seconds without a byte.
class LocalConnection {
 public:
  explicit LocalConnection(int port) : socket_(socket(AF_INET, SOCK_STREAM, 0)) {
    const timeval patience{10, 0};
    setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof(patience));
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    connected_ = connect(socket_, reinterpret_cast<sockaddr*>(&address), sizeof(address)) == 0;
  }
  ~LocalConnection() { close(socket_); }
  LocalConnection(const LocalConnection&) = delete;
  LocalConnection& operator=(const LocalConnection&) = delete;

  bool connected() const { return connected_; }
  void send(const std::string& bytes) const {
    static_cast<void>(::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL));
  }
  /// Returns all that comes until it ends in `end`, or until the other side closes.
  std::string receive(const std::string& end = "") const {
    std::string all;
    char block[4096];
    for (ssize_t n = 0; (n = recv(socket_, block, sizeof(block), 0)) > 0;) {
      all.append(block, static_cast<std::size_t>(n));
      if (!end.empty() && all.ends_with(end)) break;
    }
    return all;
  }

 private:
  int socket_;
  bool connected_ = false;
};

inline std::string ask_http(int port, const std::string& request) {
  const LocalConnection connection(port);
  connection.send(request);
  return connection.receive();
}

}  // namespace curlew
