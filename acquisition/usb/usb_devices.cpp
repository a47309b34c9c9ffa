#include "acquisition/usb/usb_devices.h"

#include <spdlog/fmt/fmt.h>

#include <array>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <span>

#include "acquisition/usb/usb_handle.h"

namespace curlew {
namespace {

constexpr int kMegabyte = 1 << 20;
constexpr const char* kMemoryLimit = "/sys/module/usbcore/parameters/usbfs_memory_mb";

std::span<const libusb_interface> interfaces(const libusb_config_descriptor& config) {
  return {config.interface, config.bNumInterfaces};
}
std::span<const libusb_interface_descriptor> settings(const libusb_interface& interface) {
  return {interface.altsetting, static_cast<std::size_t>(interface.num_altsetting)};
}
std::span<const libusb_endpoint_descriptor> endpoints(const libusb_interface_descriptor& setting) {
  return {setting.endpoint, setting.bNumEndpoints};
}

enum class Kind { kOther, kUsb3Vision, kBulk };

Kind kind_of(libusb_device* device) {
  const UsbConfig config = active_config(device);
  if (!config) return Kind::kOther;
  Kind kind = Kind::kOther;
  for (const auto& interface : interfaces(*config)) {
    for (const auto& setting : settings(interface)) {
      if (setting.bInterfaceClass == LIBUSB_CLASS_MISCELLANEOUS &&
          setting.bInterfaceSubClass == 5 && setting.bInterfaceProtocol == 0) {
        return Kind::kUsb3Vision;  // This is its control interface; the device class is EF/02/01.
      }
      if (setting.bInterfaceClass != LIBUSB_CLASS_VENDOR_SPEC) continue;
      for (const auto& endpoint : endpoints(setting)) {
        if (is_bulk_in(endpoint)) kind = Kind::kBulk;
      }
    }
  }
  return kind;
}

/// Returns what the kernel read from the device when it was plugged in; this needs no permission.
std::string kernel_text(libusb_device* device, const std::string& attribute) {
  std::array<std::uint8_t, 8> ports{};
  const int depth = libusb_get_port_numbers(device, ports.data(), int{ports.size()});
  std::string name = fmt::format("{}", libusb_get_bus_number(device));
  for (int i = 0; i < depth; ++i) {
    name += fmt::format("{}{}", i == 0 ? '-' : '.', ports.at(static_cast<std::size_t>(i)));
  }
  std::ifstream file("/sys/bus/usb/devices/" + name + "/" + attribute);
  std::string line;
  std::getline(file, line);
  return line;
}

std::string ids_of(libusb_device* device) {
  libusb_device_descriptor about{};
  libusb_get_device_descriptor(device, &about);
  return fmt::format("{:04x}:{:04x}", about.idVendor, about.idProduct);
}

/// Returns why this user cannot open it; empty if that is possible.
std::string problem_of(libusb_device* device) {
  libusb_device_handle* handle = nullptr;
  const int error = libusb_open(device, &handle);
  const UsbHandle opened(handle);
  return error == LIBUSB_SUCCESS ? std::string() : usb_open_problem(device, error);
}

}  // namespace

bool is_bulk_in(const libusb_endpoint_descriptor& endpoint) {
  return (endpoint.bEndpointAddress & LIBUSB_ENDPOINT_DIR_MASK) == LIBUSB_ENDPOINT_IN &&
         (endpoint.bmAttributes & LIBUSB_TRANSFER_TYPE_MASK) == LIBUSB_TRANSFER_TYPE_BULK;
}

std::string usb_description(libusb_device* device) {
  std::string text;
  for (const char* attribute : {"manufacturer", "product"}) {
    if (const std::string word = kernel_text(device, attribute); !word.empty()) text += word + " ";
  }
  if (const std::string serial = kernel_text(device, "serial"); !serial.empty()) {
    text += "serial number " + serial + " ";
  }
  return text + fmt::format("({}, bus {} device {})", ids_of(device), libusb_get_bus_number(device),
                            libusb_get_device_address(device));
}

std::string usb_open_problem(libusb_device* device, int error) {
  const std::string node = fmt::format("/dev/bus/usb/{:03}/{:03}", libusb_get_bus_number(device),
                                       libusb_get_device_address(device));
  if (error != LIBUSB_ERROR_ACCESS) {
    return fmt::format("{} cannot be opened: {}", node, libusb_strerror(error));
  }
  return fmt::format(
      "{} may not be opened by this user: install packaging/70-curlew-cameras.rules as "
      "/usr/lib/udev/rules.d/70-curlew-cameras.rules (the Debian package does){}, run 'udevadm "
      "control --reload' and 'udevadm trigger', and join the group plugdev",
      node,
      kind_of(device) == Kind::kUsb3Vision ? std::string()
                                           : ", with a line for " + ids_of(device) + " in it");
}

std::vector<CameraListing> list_usb_cameras() {
  const UsbContext usb = open_usb();
  std::vector<CameraListing> cameras;
  for (libusb_device* device : UsbDeviceList(usb.get())) {
    const Kind kind = kind_of(device);
    if (kind == Kind::kOther) continue;
    CameraListing camera;
    if (kind == Kind::kUsb3Vision) {
      camera.source =
          "aravis:" + kernel_text(device, "manufacturer") + "-" + kernel_text(device, "serial");
      camera.description = usb_description(device) + ", USB3 Vision";
    } else {
      camera.source = "usb:" + ids_of(device);
      camera.description = usb_description(device) + ", plain bulk";
    }
    camera.problem = problem_of(device);
    cameras.push_back(camera);
  }
  return cameras;
}

int usbfs_memory_mb() {
  int megabytes = 0;
  std::ifstream(kMemoryLimit) >> megabytes;
  return megabytes;
}

std::vector<std::string> usb_advice(const UsbLayout& layout) {
  std::vector<std::string> advice;
  if (std::filesystem::exists("/sys/bus/usb/devices") &&
      !std::filesystem::exists("/run/udev/control")) {
    advice.emplace_back(
        "udev is not running: the arrival of a USB camera is not noticed at once; start "
        "systemd-udevd");
  }
  const std::int64_t ring_bytes = std::int64_t{layout.transfers} * layout.transfer_bytes;
  const int limit_mb = usbfs_memory_mb();
  if (limit_mb > 0 && ring_bytes > std::int64_t{limit_mb} * kMegabyte) {
    advice.push_back(usb_memory_advice(layout));
  }
  for (const CameraListing& camera : list_usb_cameras()) {
    if (!camera.problem.empty()) advice.push_back(camera.source + ": " + camera.problem);
  }
  return advice;
}

std::string usb_memory_advice(const UsbLayout& layout) {
  const std::int64_t ring_bytes = std::int64_t{layout.transfers} * layout.transfer_bytes;
  return fmt::format(
      "{} transfers of {} bytes are more than the kernel's USB memory of {} MB: write {} or more "
      "to {}, or lower [usb] transfers or transfer_bytes",
      layout.transfers, layout.transfer_bytes, usbfs_memory_mb(), 2 * (ring_bytes / kMegabyte + 1),
      kMemoryLimit);
}

}  // namespace curlew
