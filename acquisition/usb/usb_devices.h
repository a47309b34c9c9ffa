// This finds the USB cameras attached to this machine, and what stands in the way of using them.
#pragma once

#include <string>
#include <vector>

#include "acquisition/camera_options.h"
#include "acquisition/list_cameras.h"

namespace curlew {

/// Lists everything on USB that could be a camera: USB3 Vision devices, which are opened through
/// Aravis ("aravis:VENDOR-SERIAL"), and devices with a vendor's own interface that has a bulk IN
/// endpoint ("usb:VID:PID", read by the frame layout of section [usb]). `problem` is set if this
/// user may not open the device. The list is empty if there is no USB. Throws Failure if libusb
/// cannot be used.
std::vector<CameraListing> list_usb_cameras();

/// Returns, for `curlew doctor`, one sentence for each thing in the way of USB cameras, with its
/// remedy: cameras that may not be opened, a kernel memory limit below what `layout` wants under
/// way, arrivals that go unnoticed. It is empty if all is well.
std::vector<std::string> usb_advice(const UsbLayout& layout);

/// Returns the kernel's limit on all USB transfers under way, in MB; 0 if there is no limit or no
/// USB.
int usbfs_memory_mb();

}  // namespace curlew
