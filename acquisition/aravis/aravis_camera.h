// This opens GenICam cameras, GigE Vision and USB3 Vision, through Aravis.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "acquisition/camera.h"
#include "acquisition/camera_options.h"
#include "acquisition/list_cameras.h"

namespace curlew {

/// Opens the GenICam camera `id`: its device id, its IP address, or nothing for the only one there
/// is. Takes control of it and sets what the options ask for. Takes about three seconds to find
/// that an address does not answer. The exchange given to start() should have two buffers more than
/// the pipeline can hold at once; with fewer, frames are lost for want of a buffer. Throws Failure
/// if the camera is not there, is controlled by another program, sends a pixel format that we do
/// not read, or refuses a setting. Throws UsageError for a setting out of its range or a feature
/// that it does not have.
std::unique_ptr<Camera> open_aravis_camera(const std::string& id, const CameraOptions& options,
                                           const ThreadStart& thread_start);

/// Lists the GenICam cameras attached to USB and to the networks of this machine. It takes a
/// second.
std::vector<CameraListing> list_aravis_cameras();

}  // namespace curlew
