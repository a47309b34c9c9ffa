// This tells a GenICam camera what it needs to know before it streams.
#pragma once

#include <string>
#include <vector>

#include "acquisition/aravis/aravis_handle.h"
#include "acquisition/aravis/aravis_pixels.h"
#include "acquisition/camera_options.h"
#include "core/frame.h"

namespace curlew {

/// Sets what the options ask for: first the features by name, then pixel format, region, rate,
/// exposure, gain, trigger, and the network's packets. Reads everything back and returns a sentence
/// for each value that the camera does not quite take. camera_name: how errors call the camera.
/// Throws UsageError for a feature that it does not have or a value out of its range, and Failure
/// if it refuses.
std::vector<std::string> apply_settings(ArvCamera* camera, const std::string& camera_name,
                                        const CameraOptions& options);

/// Returns the coding of the camera's pixel format. Throws Failure, which lists those that we read,
/// if it is none of them.
const PixelCoding& read_pixel_coding(ArvCamera* camera, const std::string& camera_name);

/// Returns size, offset and binning of the frames that the camera sends. Throws Failure if the
/// binning is unequal.
FrameFormat read_frame_format(ArvCamera* camera, const std::string& camera_name,
                              const PixelCoding& coding);

}  // namespace curlew
