// ControlSocket takes words for the running daemon and gives its answers, over a Unix socket.
#pragma once

#include <functional>
#include <string>

namespace curlew {

/// The socket's owner and group may ask. A question is one line. The answer is a line, a text or a
/// whole file, and ends with the connection.
class ControlSocket {
 public:
  /// Listens at path. A socket that a killed daemon left behind is replaced. UsageError where the
  /// folder does not exist; Failure where the socket cannot be made, or another daemon listens
  /// there.
  explicit ControlSocket(const std::string& path);
  ~ControlSocket();
  ControlSocket(const ControlSocket&) = delete;
  ControlSocket& operator=(const ControlSocket&) = delete;

  /// Waits up to timeout_ms for somebody to ask, and answers. A signal ends the wait early. Where
  /// nobody can be let in, for want of a descriptor, it waits as long.
  void serve(int timeout_ms, const std::function<std::string(const std::string&)>& answer) const;

 private:
  std::string path_;
  int listening_ = -1;
};

/// Asks the daemon that listens at path, and returns its answer. Failure where no daemon listens
/// there, or where it does not answer.
std::string ask_daemon(const std::string& path, const std::string& word);

}  // namespace curlew
