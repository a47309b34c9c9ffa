// A UsbWatcher notices at once when a USB device comes or goes.
#pragma once

#include <functional>
#include <memory>

namespace curlew {

enum class UsbChange { kArrived, kLeft };

/// Calls `changed` from a thread of its own for every USB device that comes or goes after the
/// watcher was made, camera or not: it is a reason to look again, no more. `changed` must be short
/// and must not throw. The watcher works even if there is no USB, and then never calls.
class UsbWatcher {
 public:
  /// Throws Failure if libusb cannot be used.
  explicit UsbWatcher(std::function<void(UsbChange)> changed);
  ~UsbWatcher();  ///< Returns when no call is under way and none will come.

  /// Returns false if this system cannot tell; then the caller has to look from time to time.
  bool notices() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace curlew
