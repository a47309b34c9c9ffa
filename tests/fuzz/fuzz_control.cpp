// The control socket: whatever a local user sends, one line reaches the daemon and one goes back.
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstdlib>
#include <cstring>
#include <string>

#include "service/daemon/control_socket.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  using namespace curlew;
  static const std::string path = "/tmp/curlew-fuzz." + std::to_string(getpid());
  static const ControlSocket control(path);
  const int peer = socket(AF_UNIX, SOCK_STREAM, 0);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::memcpy(address.sun_path, path.c_str(), path.size() + 1);
  if (connect(peer, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0) {
    close(peer);
    return -1;
  }
  send(peer, bytes, size < 60000 ? size : 60000, MSG_NOSIGNAL);
  shutdown(peer, SHUT_WR);
  int asked = 0;
  control.serve(100, [&](const std::string& word) {
    ++asked;
    if (word.find('\n') != std::string::npos) __builtin_trap();
    return std::string("{}");
  });
  close(peer);
  if (asked != 1) __builtin_trap();
  return 0;
}
