// These are the sockets that Aravis owns and does not show, and filters (BPF) that keep packets of
// others from them.
#pragma once

#include <linux/filter.h>

#include <cstdint>
#include <string>
#include <vector>

namespace curlew {

struct UdpSocket {
  int fd = -1;
  int port = 0;  ///< the port of this machine that it is bound to

  bool operator==(const UdpSocket&) const = default;
};

/// Returns all UDP sockets (IPv4) of this process.
std::vector<UdpSocket> udp_sockets();

/// Has the kernel run the program on every packet before it gives it to the socket. Returns false,
/// with errno, if it does not.
bool attach_filter(int fd, std::vector<sock_filter> program);

/// Returns how many packets the socket did not get, because of its filter or for want of room; 0 if
/// there is no such socket.
std::int64_t packets_refused(int fd);

/// Guards the control channel of a GigE Vision camera that has just been opened: from now on Aravis
/// gets answers of this IPv4 address and of GigE Vision's port only, and what came before is thrown
/// away. Aravis takes whatever bears the number of its request for the camera's answer, and those
/// numbers can be guessed. `before`: the sockets that there were before the camera was opened; the
/// camera's is the one that is new. Returns its descriptor, which is Aravis' to close. Failure if
/// it cannot be found or guarded.
int guard_control_channel(const std::vector<UdpSocket>& before, const std::string& address);

}  // namespace curlew
