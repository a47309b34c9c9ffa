// What a GenICam camera is told before it streams.
#pragma once

#include <string>
#include <vector>

#include "acquisition/aravis/aravis_handle.h"
#include "acquisition/aravis/aravis_pixels.h"
#include "acquisition/camera_options.h"
#include "core/frame.h"

namespace curlew {

/// Sets what the options ask for: first the features by name, then pixel format, region, rate,
/// exposure, gain, trigger, and the network's packets. Reads everything back; returns a sentence
/// for each value the camera does not quite take. camera_name: how errors call it.
/// UsageError: a feature it does not have, a value out of its range. Failure: it refuses.
std::vector<std::string> apply_settings(ArvCamera* camera, const std::string& camera_name,
                                        const CameraOptions& options);

/// The camera's pixel format. Failure, with those we read, where it is none of them.
const PixelCoding& read_pixel_coding(ArvCamera* camera, const std::string& camera_name);

/// Size, offset and binning of the frames it sends. Failure: unequal binning.
FrameFormat read_frame_format(ArvCamera* camera, const std::string& camera_name,
                              const PixelCoding& coding);

}  // namespace curlew
