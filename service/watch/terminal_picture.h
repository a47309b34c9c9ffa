// This file declares the picture of a frame for a terminal.
#pragma once

#include <string>

#include "service/page/frame_copy.h"

namespace curlew {

/// Returns lines of coloured half blocks (24-bit colours by ANSI sequences), two values below each
/// other in one character: spots, phase and circulation side by side, each at most `cols` wide, and
/// a line of their scales. Rows grow downwards. Cells with a vortex are red (+), blue (−) or white
/// (an unresolved pair). What has no value is black. cols: at least 8.
std::string terminal_picture(const FrameCopy& copy, int cols);

}  // namespace curlew
