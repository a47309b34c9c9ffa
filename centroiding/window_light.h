// The light of whole windows, which no threshold has cut.
#pragma once

#include "core/centroids.h"
#include "core/frame.h"
#include "core/image.h"

namespace curlew {

struct CentroidPlan;  // centroid.h
struct FrameLevels;   // frame_level.h

/// Sums up what is in the windows where the centroids were measured: with moved_x_px and
/// moved_y_px, and cut at the frame's edge. light_adu is what is above the frame's level, and bad
/// pixels count like the mean of the others; area_px counts the pixels of the window. A window that
/// holds more than flux and threshold allow has a sharp pixel in it, as a cosmic ray leaves; its
/// light and area are 0, as those of lenslets that are not measured.
///
/// levels: of the frame; null where they are the calibration's. The frame must be of the plan's
/// format, and the maps [rows, cols] of its lenslets. Never allocates.
void sum_window_light(const CentroidPlan& plan, FrameView frame, const Centroids& centroids,
                      const FrameLevels* levels, Image<float>& light_adu,
                      Image<float>& area_px) noexcept;

}  // namespace curlew
