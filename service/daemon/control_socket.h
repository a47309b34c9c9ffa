// ControlSocket: a word to the running daemon, and its answer, over a Unix socket.
#pragma once

#include <functional>
#include <string>

namespace curlew {

/// Its owner and group may ask. One line in, one line out.
class ControlSocket {
 public:
  /// Listens at path; one left behind by a daemon that was killed is replaced. Failure where it
  /// cannot be made, or another daemon listens there.
  explicit ControlSocket(const std::string& path);
  ~ControlSocket();
  ControlSocket(const ControlSocket&) = delete;
  ControlSocket& operator=(const ControlSocket&) = delete;

  /// Waits up to timeout_ms for somebody to ask, and answers. Returns earlier where a signal comes.
  void serve(int timeout_ms, const std::function<std::string(const std::string&)>& answer) const;

 private:
  std::string path_;
  int listening_ = -1;
};

/// Asks the daemon that listens at path. Failure where none does, or it does not answer.
std::string ask_daemon(const std::string& path, const std::string& word);

}  // namespace curlew
