// This file declares the picture of one frame: spots, slopes and vortices.
#pragma once

#include <cstdint>
#include <string>

#include "centroiding/sensor.h"
#include "service/stages.h"

namespace curlew {

/// Says which frame is drawn, and where to.
struct FramePictureOptions {
  std::int64_t frame = -1;  ///< −1: none
  std::string path;
};

/// Reads "FRAME:FILE.png", as in "12:frame.png". Throws UsageError for anything else. An empty text
/// draws nothing.
FramePictureOptions frame_picture_options(const std::string& text);

/// Writes a PNG of the slot's frame. Windows are green where there is a slope, and else say why
/// there is none: grey faint, yellow at the window's edge, orange saturated, magenta bad pixels,
/// red lost. Arrows are the spots' displacements, of which the longest but 5 % has half a pitch.
/// Circles are vortices: red with a plus, blue with a minus, and white for an unresolved pair.
/// Throws Failure, which names the file.
void write_frame_picture(const std::string& path, const Sensor& sensor, const FrameSlot& slot);

/// Returns the sentence that explains the colours.
std::string frame_picture_legend(const FramePictureOptions& options);

}  // namespace curlew
