// A stream in shared memory as a camera: the frames of any program that speaks ImageStreamIO.
#pragma once

#include <memory>
#include <string>

#include "acquisition/camera.h"

namespace curlew {

/// Opens NAME.im.shm in stream_folder(), or the file itself if the name has a '/'. Its images are
/// the frames, [rows, cols] of unsigned 8 or 16 bits or of float, and its counter numbers them: a
/// number that never came is a lost frame. CAMERA_NS is the acquisition's time by CLOCK_TAI.
///
/// Float pixels become counts by ADU = zero + scale·count; the map has room for the image that is
/// in the stream now and twice its range above that, and notes() tells it. What lies outside is
/// clipped, and what is not a number becomes the lowest count.
///
/// Throws Failure for what MappedStream::open refuses, for cubes, and for other types.
std::unique_ptr<Camera> open_stream_camera(const std::string& name,
                                           const ThreadStart& thread_start);

}  // namespace curlew
