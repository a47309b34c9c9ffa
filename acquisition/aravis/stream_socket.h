// StreamSocket guards the socket to which a GigE Vision camera sends its frames.
#pragma once

#include <cstdint>
#include <mutex>
#include <string>

namespace curlew {

/// Says who may send frames.
struct StreamSender {
  std::string address;     ///< the camera's IPv4 address
  std::uint16_t port = 0;  ///< the port that it sends from; 0 where it does not tell
};

/// Aravis owns the socket and does not show it, so it is found among this process' descriptors. It
/// takes every packet for the camera's, and 0.8.26 does not survive a payload packet that is
/// shorter than its header. Therefore the kernel hands it only what comes from the camera and is
/// long enough for what it says it is. Any thread may call refused().
class StreamSocket {
 public:
  /// Finds the UDP socket bound to `port`, and guards it from now on. Packets of others that came
  /// before are gone when it returns: Aravis has ignored them for want of a buffer, as long as it
  /// has been given none. Throws Failure if the socket cannot be found or guarded.
  void guard(int port, const StreamSender& sender);

  /// Sets the kernel's receive buffer and returns what it really got, in bytes.
  int set_receive_buffer(int bytes) const;

  /// Call it before Aravis closes the socket.
  void forget();

  /// Returns how many packets Aravis did not get: others', malformed ones, and those for which the
  /// receive buffer had no room.
  std::int64_t refused() const;

 private:
  mutable std::mutex mutex_;
  int fd_ = -1;
  std::int64_t refused_before_ = 0;  ///< those of sockets that are forgotten
};

}  // namespace curlew
