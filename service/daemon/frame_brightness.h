// How bright the brightest spots of a frame are.
#pragma once

#include "core/frame.h"

namespace curlew {

/// Returns how far the brightest spots rise over the level, as a part of what the level leaves
/// until saturation; 1 and more is saturated. The level is the frame's median. Of the brightest
/// pixels of all squares of pitch_px, the hundredth part, at least two, are passed over. A pixel
/// counts with at most four times what the brightest of its neighbours has, so that hot pixels and
/// cosmic rays do not count. saturation_counts is above every level. Any thread may call it.
double frame_brightness(FrameView frame, double pitch_px, double saturation_counts);

}  // namespace curlew
