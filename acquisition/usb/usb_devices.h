// USB cameras attached to this machine, and what stands in the way of using them.
#pragma once

#include <string>
#include <vector>

#include "acquisition/camera_options.h"
#include "acquisition/list_cameras.h"

namespace curlew {

/// Everything on USB that could be a camera: USB3 Vision devices, which are opened through Aravis
/// ("aravis:VENDOR-SERIAL"), and devices with a vendor's own interface that has a bulk IN endpoint
/// ("usb:VID:PID", read by the frame layout of section [usb]). `problem` is set where this user may
/// not open the device. Empty where there is no USB. Failure where libusb cannot be used.
std::vector<CameraListing> list_usb_cameras();

/// For `curlew doctor`: one sentence for each thing in the way of USB cameras, with its remedy:
/// cameras that may not be opened, a kernel memory limit below what `layout` wants under way,
/// arrivals that go unnoticed. Empty where all is well.
std::vector<std::string> usb_advice(const UsbLayout& layout);

/// The kernel's limit on all USB transfers under way, in MB; 0: none, or there is no USB.
int usbfs_memory_mb();

}  // namespace curlew
