// These types give back by themselves what libusb hands out. Only files in acquisition/usb/ include
// this one.
#pragma once

#include <libusb.h>

#include <cstddef>
#include <memory>
#include <string>

#include "acquisition/camera_options.h"
#include "core/error.h"

namespace curlew {

struct UsbExit {
  void operator()(libusb_context* context) const { libusb_exit(context); }
};
struct UsbClose {
  void operator()(libusb_device_handle* handle) const { libusb_close(handle); }
};
struct UsbFreeConfig {
  void operator()(libusb_config_descriptor* config) const { libusb_free_config_descriptor(config); }
};
struct UsbFreeTransfer {
  void operator()(libusb_transfer* transfer) const { libusb_free_transfer(transfer); }
};
using UsbContext = std::unique_ptr<libusb_context, UsbExit>;
using UsbHandle = std::unique_ptr<libusb_device_handle, UsbClose>;
using UsbConfig = std::unique_ptr<libusb_config_descriptor, UsbFreeConfig>;
using UsbTransfer = std::unique_ptr<libusb_transfer, UsbFreeTransfer>;

/// Opens libusb. Each user of it has a context of its own. It works even if there is no USB at all.
/// Throws Failure if libusb cannot be used.
inline UsbContext open_usb() {
  libusb_context* context = nullptr;
  if (const int error = libusb_init(&context); error != LIBUSB_SUCCESS) {
    throw Failure(std::string("USB cannot be used: ")
                      .append(libusb_strerror(error))
                      .append(" (under systemd, RestrictAddressFamilies= must allow AF_NETLINK)"));
  }
  return UsbContext(context);
}

/// Lists the devices attached now; its pointers are valid as long as the list.
class UsbDeviceList {
 public:
  explicit UsbDeviceList(libusb_context* context)
      : count_(libusb_get_device_list(context, &devices_)) {}
  ~UsbDeviceList() {
    if (devices_ != nullptr) libusb_free_device_list(devices_, 1);
  }
  UsbDeviceList(const UsbDeviceList&) = delete;
  UsbDeviceList& operator=(const UsbDeviceList&) = delete;

  libusb_device** begin() const { return devices_; }
  libusb_device** end() const { return count_ > 0 ? devices_ + count_ : devices_; }

 private:
  libusb_device** devices_ = nullptr;
  std::ptrdiff_t count_ = 0;
};

/// Returns the configuration in use, or else the first one; empty if none can be read.
inline UsbConfig active_config(libusb_device* device) {
  libusb_config_descriptor* config = nullptr;
  if (libusb_get_active_config_descriptor(device, &config) != LIBUSB_SUCCESS &&
      libusb_get_config_descriptor(device, 0, &config) != LIBUSB_SUCCESS) {
    return nullptr;
  }
  return UsbConfig(config);
}

bool is_bulk_in(const libusb_endpoint_descriptor& endpoint);

/// Returns "Vendor Product serial number S (1a2b:3c4d, bus 1 device 5)", as far as the kernel
/// knows.
std::string usb_description(libusb_device* device);

/// Returns why a device could not be opened, and what to do: "/dev/bus/usb/001/005 may not be …".
std::string usb_open_problem(libusb_device* device, int error);

/// Returns why the kernel had no memory for the transfers of this layout, and what to do.
std::string usb_memory_advice(const UsbLayout& layout);

}  // namespace curlew
