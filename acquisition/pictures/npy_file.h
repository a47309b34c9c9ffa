// This file declares what is read from npy, numpy's format for one array.
#pragma once

#include <memory>
#include <string>

#include "acquisition/pictures/picture_file.h"

namespace curlew {

/// Opens an array [rows, cols] or [frames, rows, cols] of 8-, 16- or 32-bit integers, or of floats
/// (https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html). Throws Failure for any
/// other, and for a file that is damaged or shorter than it says.
std::unique_ptr<PictureFile> open_npy(const std::string& path);

}  // namespace curlew
