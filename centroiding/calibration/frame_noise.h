// This file declares the estimate of the noise that a frame really has, which reports compare with
// the sensor file's.
#pragma once

#include "centroiding/sensor.h"
#include "core/frame.h"

namespace curlew {

struct FrameNoise {
  double noise_adu = 0.0;  ///< standard deviation of one pixel; 0 where there are too few pixels
  double light_adu = 0.0;  ///< median above the background in the same places; 0 as well
};

/// Estimates the noise from the corners of the windows, where light is least. It takes the median
/// difference of neighbouring pixels, which is robust against spots that reach the corners. The
/// frame must fit the sensor. This is for reports and not for the frame path.
FrameNoise estimate_frame_noise(const Sensor& sensor, const FrameFormat& format, FrameView frame);

}  // namespace curlew
