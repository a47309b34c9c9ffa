// The noise a frame really has, to hold against what the sensor file says.
#pragma once

#include "centroiding/sensor.h"
#include "core/frame.h"

namespace curlew {

struct FrameNoise {
  double noise_adu = 0.0;  ///< standard deviation of one pixel; 0 where too few pixels can tell
  double light_adu = 0.0;  ///< median above the background in the same places
};

/// From the corners of the windows, where light is least: noise by the differences of neighbouring
/// pixels, robust against spots that reach them. The frame must fit the sensor. For reports, not
/// for the frame path.
FrameNoise estimate_frame_noise(const Sensor& sensor, const FrameFormat& format, FrameView frame);

}  // namespace curlew
