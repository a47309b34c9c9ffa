// This emulates a USB3 Vision camera: registers, a GenICam description, and a stream of Mono16.
#pragma once

#include <cstdint>
#include <mutex>
#include <span>
#include <string>

#include "tests/acquisition/usb/emulated_usb.h"

namespace curlew {

class EmulatedVisionCamera : public EmulatedUsbDevice {
 public:
  EmulatedVisionCamera(int rows, int cols);
  ~EmulatedVisionCamera() override;

  static constexpr const char* kVendor = "Curlew Works";
  static constexpr const char* kModel = "Vision 1";
  static constexpr const char* kSerial = "V0001";

  /// Says whether the host has started the acquisition and enabled the stream.
  bool acquiring() const;
  bool wait_until_acquiring() const;  ///< Returns false if it did not within 10 s.

  /// Sends leader, payload and trailer. Returns false if the camera is not plugged in.
  bool send_frame(std::uint64_t id, std::span<const std::uint16_t> pixels);
  /// Sends the leader and the first bytes of the payload.
  bool send_part_of_frame(std::uint64_t id, std::span<const std::uint16_t> pixels,
                          std::size_t bytes);

 protected:
  void received(int endpoint, const Bytes& bytes) override;

 private:
  bool send_leader(std::uint64_t id);

  int rows_;
  int cols_;
  mutable std::mutex memory_mutex_;
  Bytes memory_;  ///< all registers, and the GenICam description
};

}  // namespace curlew
