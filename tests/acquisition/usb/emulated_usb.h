// This emulates USB devices, under umockdev: libusb, udev and the kernel's usbfs see them.
#pragma once

#include <umockdev.h>

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <mutex>
#include <span>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace curlew {

using Bytes = std::vector<std::uint8_t>;

/// Says whether the program runs under umockdev-wrapper.
bool usb_can_be_emulated();

/// Is an empty /sys and /dev for this process. There is one for all its life, because Aravis
/// listens to the first that it ever saw.
class EmulatedUsb {
 public:
  static EmulatedUsb& instance();
  ~EmulatedUsb();
  EmulatedUsb(const EmulatedUsb&) = delete;
  EmulatedUsb& operator=(const EmulatedUsb&) = delete;
  UMockdevTestbed* testbed() const { return testbed_; }
  std::string root() const;

 private:
  EmulatedUsb();
  UMockdevTestbed* testbed_;
};

struct UsbIdentity {
  std::uint16_t vendor_id = 0;
  std::uint16_t product_id = 0;
  std::string manufacturer, product, serial;
  std::size_t packet_bytes = 512;
  Bytes descriptors;  ///< device descriptor, then the configuration with all it contains
};

/// Emulates one device, which may be plugged and unplugged as often as wanted. The bytes given to
/// send() wait, as in a device's buffer, until the host has transfers for them.
class EmulatedUsbDevice {
 public:
  explicit EmulatedUsbDevice(UsbIdentity identity);
  virtual ~EmulatedUsbDevice();
  EmulatedUsbDevice(const EmulatedUsbDevice&) = delete;
  EmulatedUsbDevice& operator=(const EmulatedUsbDevice&) = delete;

  void plug();
  void unplug();
  bool plugged() const;
  std::string node() const;  ///< "/dev/bus/usb/001/005"

  /// Sends the next bytes of a bulk IN endpoint. ends_packet: a short (or empty) packet ends with
  /// them. Waits while many bytes are waiting already. Returns false if the device is not plugged
  /// in.
  bool send(int endpoint, std::span<const std::uint8_t> bytes, bool ends_packet);
  /// Waits until the host has taken everything sent. Returns false if it did not within 10 s.
  bool drained();
  /// Makes every transfer under way on this endpoint come back with this (negative) errno.
  void break_transfers(int endpoint, int status);

  // These say how the kernel behaves.
  bool busy = false;                            ///< whether another program has the interface
  std::size_t memory_limit_bytes = 1ULL << 40;  ///< limit of usbfs memory

  int opened_transfers() const;  ///< the number of transfers under way now

 protected:
  /// Is called when the host wrote to a bulk OUT endpoint.
  virtual void received(int /*endpoint*/, const Bytes& /*bytes*/) {}

  /// Unplugs the device for good; received() is never called again. Every destructor must call it
  /// first of all, because a process that has the node open may go on asking when this object is
  /// gone.
  void retire();

 private:
  /// Stands for one time of being plugged in. A process that had the device open then never sees it
  /// again.
  using Connection = UMockdevIoctlBase*;
  struct Transfer {
    Connection connection = nullptr;
    UMockdevIoctlData* urb = nullptr;
    UMockdevIoctlData* buffer = nullptr;
    Bytes data;  ///< bytes received so far
    int endpoint = 0;
    std::size_t length = 0;
  };
  struct Outgoing {
    Bytes bytes;
    std::size_t taken = 0;
    bool ends_packet = false;
  };
  struct Reaping {
    Connection connection;
    UMockdevIoctlClient* client;
    UMockdevIoctlData* data;
    std::chrono::steady_clock::time_point deadline;
    bool waits;
  };
  using Lock = std::unique_lock<std::mutex>;

  static gboolean on_ioctl(UMockdevIoctlBase* base, UMockdevIoctlClient* client, gpointer self);
  bool ioctl(Connection connection, UMockdevIoctlClient* client);
  void submit(UMockdevIoctlClient* client, UMockdevIoctlData* urb);
  bool discard(std::uintptr_t address);
  void answer_control(Transfer& transfer);
  void serve(int endpoint);
  void complete(std::size_t index, int status);
  void reap();
  void tick(const std::stop_token& stop);

  EmulatedUsb& usb_ = EmulatedUsb::instance();
  UsbIdentity identity_;
  std::string syspath_;
  int address_ = 0;
  std::vector<std::pair<std::string, Connection>>
      connections_;  ///< by node; the last is the one now

  mutable std::mutex mutex_;
  std::condition_variable taken_;
  bool plugged_ = false;
  std::vector<Transfer> pending_;  ///< in the order they were submitted
  std::deque<Transfer> done_;
  std::deque<Reaping> reaping_;
  std::map<int, std::deque<Outgoing>> outgoing_;
  std::map<int, std::size_t> waiting_bytes_;
  std::jthread ticker_;
};

}  // namespace curlew
