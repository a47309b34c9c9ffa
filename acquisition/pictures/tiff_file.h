// This file declares what is read from TIFF, by libtiff.
#pragma once

#include <memory>
#include <string>

#include "acquisition/pictures/picture_file.h"

namespace curlew {

/// Opens a TIFF of 8 or 16 bits of grey, or of 32- or 64-bit floats; each page is a frame. Throws
/// Failure for any other, for pages of different sizes or types, and for a damaged file.
std::unique_ptr<PictureFile> open_tiff(const std::string& path);

}  // namespace curlew
