// This opens a plain USB camera, which sends frame after frame on a bulk endpoint without being
// asked.
#pragma once

#include <cstdint>
#include <memory>

#include "acquisition/camera.h"
#include "acquisition/camera_options.h"

namespace curlew {

/// Opens the first device with these ids and reads frames as options.usb says (UsbLayout and
/// UsbFrameAssembler tell how). The kernel's driver is detached if it has one; the interface is
/// claimed and the alternate setting chosen. Throws Failure if the device is not attached, not
/// permitted, or in use by another program. Throws UsageError for a layout without rows or columns,
/// or one that does not fit the device.
///
/// Frames come from a ring of transfers on one thread. Frames that find no free buffer are lost and
/// counted, and the stream goes on. The camera's clock is unknown, so camera_ns is 0.
std::unique_ptr<Camera> open_usb_camera(std::uint16_t vendor_id, std::uint16_t product_id,
                                        const CameraOptions& options,
                                        const ThreadStart& thread_start);

}  // namespace curlew
