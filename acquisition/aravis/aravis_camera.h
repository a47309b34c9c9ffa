// GenICam cameras, GigE Vision and USB3 Vision, through Aravis.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "acquisition/camera.h"
#include "acquisition/camera_options.h"
#include "acquisition/list_cameras.h"

namespace curlew {

/// Opens the GenICam camera `id`: its device id, its IP address, or nothing for the only one there
/// is. Takes control of it and sets what the options ask for. Takes about three seconds to say that
/// an address does not answer. The exchange given to start() should have two buffers more than the
/// pipeline can hold at once; with fewer, frames are lost for want of a buffer.
/// Failure: not there, controlled by another program, a pixel format we do not read, a setting the
/// camera refuses. UsageError: a setting out of its range, a feature it does not have.
std::unique_ptr<Camera> open_aravis_camera(const std::string& id, const CameraOptions& options,
                                           const ThreadStart& thread_start);

/// The GenICam cameras attached to USB and to the networks of this machine. Takes a second.
std::vector<CameraListing> list_aravis_cameras();

}  // namespace curlew
