// This file declares where windows are laid round the reference spots.
#pragma once

#include "centroiding/calibration/lenslet_grid_finder.h"
#include "centroiding/sensor.h"
#include "core/image.h"

namespace curlew {

/// Lays a window round every spot, [rows, cols] of lenslets. A window is floor(pitch) pixels wide
/// and high (narrower where the grid is turned) and centred on the spot's nearest pixel. The
/// frame's rim clips it, and a window of which less than half is left is empty, as where there is
/// no spot. Neighbours share at most one column or row of pixels.
Image<Window> lay_windows(const FoundGrid& found, int frame_rows, int frame_cols);

}  // namespace curlew
