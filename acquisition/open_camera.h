// This opens the camera that a word of the command line or the configuration names.
#pragma once

#include <memory>

#include "acquisition/camera.h"
#include "acquisition/camera_options.h"

namespace curlew {

/// Opens what options.source names. Throws Failure if it is not there or refuses, and UsageError
/// for a source or a setting that makes no sense.
std::unique_ptr<Camera> open_camera(const CameraOptions& options, const ThreadStart& thread_start);

/// Says whether the source is a device or another program's stream, which may come later, and not a
/// file or the simulator.
bool comes_and_goes(const CameraOptions& options);

}  // namespace curlew
