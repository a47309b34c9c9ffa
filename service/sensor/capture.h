// Capture takes a few frames straight from a camera into a recording, for a calibration.
#pragma once

#include <cstdint>
#include <string>

#include "acquisition/camera_options.h"

namespace curlew {

/// Writes `frames` frames to the recording at path. Frames for which the disk is too slow are
/// skipped. Throws Failure if the camera is not there, stops sending or the file cannot be written;
/// then no file is left.
void capture_frames(const CameraOptions& options, std::int64_t frames, const std::string& path);

}  // namespace curlew
