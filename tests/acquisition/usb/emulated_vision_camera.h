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
  /// padding_bytes: how many bytes follow each row of a frame.
  EmulatedVisionCamera(int rows, int cols, int padding_bytes = 0);
  ~EmulatedVisionCamera() override;

  static constexpr const char* kVendor = "Curlew Works";
  static constexpr const char* kModel = "Vision 1";
  static constexpr const char* kSerial = "V0001";

  /// Says whether the host has started the acquisition and enabled the stream.
  bool acquiring() const;
  bool wait_until_acquiring() const;  ///< Returns false if it did not within 10 s.

  /// Sends leader, payload and trailer, pixels with their padding. Returns false if the camera is
  /// not plugged in.
  bool send_frame(std::uint64_t id, std::span<const std::uint16_t> pixels);
  /// Sends the leader and the first bytes of the payload.
  bool send_part_of_frame(std::uint64_t id, std::span<const std::uint16_t> pixels,
                          std::size_t bytes);
  /// From now on leaders say that so many bytes follow each row, whatever does.
  void claim_padding(int bytes) { claimed_padding_ = bytes; }

 protected:
  void received(int endpoint, const Bytes& bytes) override;

 private:
  bool send_leader(std::uint64_t id);

  int rows_;
  int cols_;
  int padding_;
  int claimed_padding_;
  mutable std::mutex memory_mutex_;
  Bytes memory_;  ///< all registers, and the GenICam description
};

}  // namespace curlew
